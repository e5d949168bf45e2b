//! Images that renderers send (`iv -listen`).
//!
//! The packets of clients become images of a [`Live`]. As in other viewers, an image belongs to its name and not to its
//! sender. A script may create it through one connection and update it through another. Only clients that support the
//! extension (several runs of `gelato`) get images of their own when they use one name at the same time.

pub(crate) mod files;

use granita_base::{Location, Reporter, Severity};
use granita_display::packet::{Channel, DEFAULT_PORT};
use granita_display::{
    Client, DisplayError, Ending, Listener, Packet, PacketLimits, ServerLimits, Sink, Sparingly,
    listen_address,
};
use granita_image::PixelRect;
use granita_view::{EditSender, Live, RequestSender};
use parking_lot::{Mutex, MutexGuard};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// The source and the destination of images.
#[derive(clap::Args, Debug, Default)]
pub(crate) struct NetArgs {
    /// Receive images that renderers send to this port: gelato -display, pbrt, and other programs with the protocol of
    /// tev. Without ADDRESS, from this machine only; * is every address. Without files, 14158
    #[arg(long, value_name = "[ADDRESS:]PORT", help_heading = "Live images")]
    pub(crate) listen: Option<String>,

    /// Show the received images and the files in browsers instead of a window. Prints the address of the page. 0 is any
    /// port
    #[arg(long, value_name = "[ADDRESS:]PORT", help_heading = "Live images")]
    pub(crate) serve: Option<String>,

    /// A further host name by which browsers may request the page of -serve, besides its address, localhost and the
    /// name in -serve; may be repeated
    #[arg(long, value_name = "NAME", help_heading = "Live images")]
    pub(crate) servename: Vec<String>,

    /// Allow senders of images to open files of this machine
    #[arg(long, help_heading = "Live images")]
    pub(crate) allowopen: bool,

    /// Open what images name as their foreground and background, but nothing else: for the program that started this
    /// one
    #[arg(long, hide = true)]
    pub(crate) allowlayers: bool,

    /// With -serve: end with standard input, which the program that started this one holds
    #[arg(long, hide = true, requires = "serve")]
    pub(crate) endwithinput: bool,
}

/// A client's request about a file. It is granted only with `-allowopen`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Wanted {
    /// Opens a file.
    Open {
        /// The path on this machine.
        path: String,
        /// The channels; empty for all.
        selector: String,
        /// True when the file is also shown.
        focus: bool,
    },
    /// Reads a file again.
    Reload {
        /// The name of its image.
        name: String,
        /// True when the file is also shown.
        focus: bool,
    },
}

/// Executes a client's request about a file. Returns the reason when it is refused.
pub(crate) type OpenFile = dyn Fn(Wanted) -> Result<(), String> + Send + Sync;

/// Listens as the options request. With `by_default` it also listens without `-listen`, on the default port if that is
/// free. Without `open`, clients cannot open files.
///
/// # Errors
/// Returns an error when `-listen` is not an address, or when the address is not available.
pub(crate) fn begin(
    args: &NetArgs,
    by_default: bool,
    live: &Live,
    reporter: &Reporter,
    open: Option<Box<OpenFile>>,
) -> Result<Option<Listener>, DisplayError> {
    if args.listen.is_none() && !by_default {
        return Ok(None);
    }
    match address(args).and_then(|address| start(address, live, reporter, open, args.allowlayers)) {
        Ok(listener) => Ok(Some(listener)),
        Err(error) if args.listen.is_none() => {
            reporter.warning(format!("{error}: no renderer can send images here"));
            Ok(None)
        }
        Err(error) => Err(error),
    }
}

/// Returns the address to listen on, which is the value of `-listen` or the default port of this machine.
///
/// # Errors
/// Returns an error when `-listen` is not an address.
fn address(args: &NetArgs) -> Result<SocketAddr, DisplayError> {
    match &args.listen {
        Some(text) => listen_address(text),
        None => Ok((std::net::Ipv4Addr::LOCALHOST, DEFAULT_PORT).into()),
    }
}

/// Listens until the result is dropped, and prints the address. Without `open`, clients cannot open files, but with
/// `layers` they can open those that an image has as its foreground and background.
///
/// # Errors
/// Returns [`DisplayError::Io`], for example when another process listens there.
fn start(
    address: SocketAddr,
    live: &Live,
    reporter: &Reporter,
    open: Option<Box<OpenFile>>,
    layers: bool,
) -> Result<Listener, DisplayError> {
    let taken = live.limits();
    let packet = PacketLimits {
        dimension: taken.dimension,
        channels: u32::try_from(taken.channels).unwrap_or(u32::MAX),
        text_bytes: taken.name_bytes,
        panel_bytes: taken.panel_bytes,
        ..PacketLimits::default()
    };
    // Repeated connections must not fill the terminal.
    let warnings = Mutex::new(Sparingly::new(20, Duration::from_secs(60)));
    let layers = layers || open.is_some();
    let (live, reporter_inside) = (live.clone(), reporter.clone());
    let feeder = Feeder { live, reporter: reporter_inside, open, layers, names: Mutex::default(), warnings };
    let limits = ServerLimits { packet, ..ServerLimits::default() };
    let listener = Listener::bind(address, limits, Arc::new(feeder))?;
    if !address.ip().is_loopback() {
        reporter.warning(format!(
            "{address} can be reached from other machines: every program there can send images"
        ));
    }
    // The program that started this one waits for these words.
    let text = format!("iv: listening on {}\n", listener.address());
    reporter.say(Severity::Message, &Location::default(), text);
    Ok(listener)
}

/// Makes images from packets.
struct Feeder {
    live: Live,
    reporter: Reporter,
    open: Option<Box<OpenFile>>,
    /// True when foregrounds and backgrounds are opened.
    layers: bool,
    names: Mutex<Names>,
    warnings: Mutex<Sparingly>,
}

/// The images of each client.
#[derive(Default)]
struct Names {
    /// Maps a client and its name of an image to the name in the [`Live`].
    of_client: BTreeMap<(u64, String), String>,
    /// Maps a name in the [`Live`] to the id of the client that makes the image.
    makers: BTreeMap<String, u64>,
}

impl Names {
    /// Returns the name in the [`Live`] of the image that a client calls `name`.
    fn here(&self, client: u64, name: &str) -> String {
        self.of_client.get(&(client, name.to_owned())).cloned().unwrap_or_else(|| name.to_owned())
    }
}

impl Feeder {
    fn warn(&self, client: &Client, what: &str) {
        let text = format!("{}: {what}", client.address());
        let mut warnings = self.warnings.lock();
        if let Some(text) = warnings.say(Instant::now(), &text) {
            drop(warnings);
            self.reporter.warning(text);
        }
    }

    fn names(&self) -> MutexGuard<'_, Names> {
        self.names.lock()
    }

    fn create(
        &self,
        client: &Arc<Client>,
        own: String,
        size: (u32, u32),
        channels: &[String],
        focus: bool,
    ) -> Result<(), String> {
        let mut names = self.names();
        let mut name = names.here(client.id(), &own);
        let mut number = 2;
        while client.is_two_way() && names.makers.get(&name).is_some_and(|maker| *maker != client.id()) {
            name = format!("{own} ({number})");
            number += 1;
        }
        self.live.create(&name, size.0, size.1, channels).map_err(|e| e.to_string())?;
        names.makers.insert(name.clone(), client.id());
        names.of_client.insert((client.id(), own.clone()), name.clone());
        drop(names);
        if client.is_two_way() {
            let (requested, edited, image) = (client.clone(), client.clone(), own.clone());
            let sender = RequestSender::new(move |request| {
                let name = own.clone();
                requested.send(Packet::Request { name, request })
            });
            self.live.answer(&name, sender);
            let sender = EditSender::new(move |text| {
                let (name, text) = (image.clone(), text.to_owned());
                edited.send(Packet::Edit { name, text })
            });
            self.live.take_edits(&name, sender);
        }
        if focus {
            self.live.show(&name);
        }
        Ok(())
    }

    fn update(
        &self,
        name: &str,
        channels: &[Channel],
        rect: PixelRect,
        values: &[f32],
    ) -> Result<(), String> {
        let info = self.live.info(name).ok_or_else(|| format!("there is no image \"{name}\""))?;
        let place = |channel: &Channel| {
            let index = info.channels.iter().position(|n| *n == channel.name);
            let index = index.ok_or_else(|| format!("\"{name}\" has no channel \"{}\"", channel.name))?;
            // A number that does not fit into memory is also larger than the number of values.
            let usize_of = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
            Ok((index, usize_of(channel.offset), usize_of(channel.stride)))
        };
        let places: Vec<(usize, usize, usize)> = channels.iter().map(place).collect::<Result<_, String>>()?;
        self.live.update(name, &places, rect, values).map_err(|e| e.to_string())
    }

    fn file(&self, wanted: Wanted) -> Result<(), String> {
        match &self.open {
            Some(open) => open(wanted),
            None => Err("files are not opened for clients (see -allowopen)".to_owned()),
        }
    }
}

impl Sink for Feeder {
    fn packet(&self, client: &Arc<Client>, packet: Packet) -> Result<(), String> {
        let here = |name: &str| self.names().here(client.id(), name);
        match packet {
            Packet::CreateImage { name, focus, width, height, channels } => {
                self.create(client, name, (width, height), &channels, focus)?;
            }
            Packet::UpdateImage { name, focus, channels, rect, values } => {
                let name = here(&name);
                self.update(&name, &channels, rect, &values)?;
                if focus {
                    self.live.show(&name);
                }
            }
            Packet::CloseImage { name: own } => {
                let name = here(&own);
                self.live.close(&name);
                let mut names = self.names();
                names.makers.remove(&name);
                names.of_client.remove(&(client.id(), own));
            }
            Packet::OpenImage { path, selector, focus } => {
                self.file(Wanted::Open { path, selector, focus })?;
            }
            Packet::ReloadImage { name, focus } => self.file(Wanted::Reload { name, focus })?,
            Packet::Mark { name, rect } => self.live.mark(&here(&name), rect),
            Packet::Wish { name, mut wishes } => {
                // Clients may not open files of this machine.
                if !self.layers {
                    wishes.foreground.clear();
                    wishes.background.clear();
                }
                self.live.wish(&here(&name), wishes);
            }
            Packet::Panel { name, part, text } => {
                self.live.show_panel(&here(&name), &part, &text).map_err(|e| e.to_string())?;
            }
            Packet::Finished { name: own, complete } => {
                let name = here(&own);
                match complete {
                    true => self.live.finish(&name),
                    false => self.live.lost(&name, "the render was stopped before it was complete"),
                }
                let mut names = self.names();
                names.makers.remove(&name);
                names.of_client.remove(&(client.id(), own));
            }
            Packet::VectorGraphics { name, focus, append, commands } => {
                let name = here(&name);
                self.live.draw(&name, append, &commands).map_err(|e| e.to_string())?;
                if focus {
                    self.live.show(&name);
                }
            }
            _ => (),
        }
        Ok(())
    }

    fn trouble(&self, client: &Client, what: &str) {
        self.warn(client, what);
    }

    fn gone(&self, client: &Client, ending: &Ending) {
        let mut names = self.names();
        let own = names.of_client.keys().filter(|(id, _)| *id == client.id()).cloned().collect::<Vec<_>>();
        let gone: Vec<String> = own.iter().filter_map(|key| names.of_client.remove(key)).collect();
        names.makers.retain(|_, maker| *maker != client.id());
        drop(names);
        let note = match ending {
            // Other programs do not send the end of an image.
            Ending::Closed if !client.is_two_way() => None,
            Ending::Closed => Some("the sender disconnected before the image was complete".to_owned()),
            Ending::Broken(what) => Some(format!("the connection to the sender is lost: {what}")),
        };
        for name in gone {
            match &note {
                Some(note) => self.live.lost(&name, note),
                None => self.live.finish(&name),
            }
        }
        if let Ending::Broken(what) = ending {
            self.warn(client, what);
        }
    }
}

#[cfg(test)]
mod tests;
