// tidy: long: the encoding and the decoding of each packet are in one file, so that one cannot change alone
//! Packets, with their content and their bytes.
//!
//! A packet is its length in bytes (`u32`, these four included), its type (`u8`), and the content of the type. Numbers
//! are little-endian. A text ends with a zero byte. A flag is a byte, which is 1 for true. The types up to 8 are those
//! that `tev` established. All current senders of it write them like this:
//!
//! | type | packet | content |
//! |---|---|---|
//! | 0 | open image | flag focus, text `path:selector` (selector optional) |
//! | 1 | reload image | flag focus, text name |
//! | 2 | close image | text name |
//! | 3 | update image | flag focus, text name, text channel, `i32` x, y, width, height, `f32` values |
//! | 4 | create image | flag focus, text name, `i32` width, height, count of channels, text names |
//! | 5 | update image, 2nd form | flag focus, text name, `i32` count, text channels, `i32` x, y, width, height, planes of `f32` |
//! | 6 | update image, 3rd form | as the 2nd, with `i64` offsets, `i64` strides of all channels before the values |
//! | 7 | open image, 2nd form | flag focus, text path, text selector |
//! | 8 | vector graphics | flag focus, text name, flag append, `i32` count, commands: `i8` type, its `f32` arguments |
//!
//! In the 3rd form the value of channel c in pixel k (row by row) has the index `offset[c] + k * stride[c]`.
//!
//! The types from 100 are an extension. They are sent only between a client and a server that have agreed on it (see
//! [`GREETING`]):
//!
//! | type | packet | content |
//! |---|---|---|
//! | 100 | hello | `u32` version |
//! | 101 | mark: these pixels are being rendered | text name, `i32` x, y, width, height |
//! | 102 | wishes: display settings | text name, flag fullscreen, `u32` zoom, text foreground, text background |
//! | 103 | finished | text name, flag complete |
//! | 104 | panel: a part of the controls beside the image | text name, text part, long text (JSON, empty to remove it) |
//! | 110 | center (to the client) | text name, `i32` x, y |
//! | 111 | priority (to the client) | text name, `i32` x, y, width, height |
//! | 112 | abort (to the client) | text name |
//! | 113 | edit: a user used the panel (to the client) | text name, long text (JSON) |

use crate::{DisplayError, Result};
use granita_image::{Draw, PixelRect, Request, Wishes};

/// The port on which viewers listen.
pub const DEFAULT_PORT: u16 = 14158;

/// The name of an image that does not exist. A client that supports the extension first requests that this image be
/// closed. Any server of the protocol accepts that and does nothing. The server of this crate answers with
/// [`Packet::Hello`]. Before that answer a client sends packets of types up to 8 only, and a server that did not
/// receive the request sends nothing.
pub const GREETING: &str = "\u{1}granita hello";

/// The version of the extension.
pub const VERSION: u32 = 2;

/// The largest number of bytes of the JSON of [`Packet::Edit`].
pub const EDIT_BYTES: usize = 32 << 10;

/// The limits of a receiver. They are checked before anything is allocated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PacketLimits {
    /// The largest number of bytes of a packet.
    pub packet_bytes: u32,
    /// The largest number of pixels across or down.
    pub dimension: u32,
    /// The largest number of channels.
    pub channels: u32,
    /// The largest number of bytes of a text.
    pub text_bytes: usize,
    /// The largest number of commands of vector graphics.
    pub commands: u32,
    /// The largest number of bytes of a part of a panel.
    pub panel_bytes: usize,
}

impl Default for PacketLimits {
    /// Returns 256 MiB, 64 Ki pixels a side, 256 channels, 4 KiB for a text, 64 Ki commands, and 4 MiB for a part of a
    /// panel.
    fn default() -> Self {
        Self {
            packet_bytes: 256 << 20,
            dimension: 1 << 16,
            channels: 256,
            text_bytes: 4096,
            commands: 1 << 16,
            panel_bytes: 4 << 20,
        }
    }
}

/// The positions of the values of a channel in a packet.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Channel {
    /// The name of the channel, for example "R".
    pub name: String,
    /// The index of its first value.
    pub offset: u64,
    /// The distance from the value of one pixel to that of the next, in values.
    pub stride: u64,
}

/// One message.
#[derive(Clone, Debug, PartialEq)]
pub enum Packet {
    /// Opens a file of the viewer's machine.
    OpenImage {
        /// The path of the file.
        path: String,
        /// The channels. It is empty for all.
        selector: String,
        /// True to show the image.
        focus: bool,
    },
    /// Reads a file again.
    ReloadImage {
        /// The name of the image.
        name: String,
        /// True to show the image.
        focus: bool,
    },
    /// Closes an image.
    CloseImage {
        /// The name of the image.
        name: String,
    },
    /// Creates a black image.
    CreateImage {
        /// The name of the image.
        name: String,
        /// True to show the image.
        focus: bool,
        /// The number of pixels across.
        width: u32,
        /// The number of pixels down.
        height: u32,
        /// The names of its channels.
        channels: Vec<String>,
    },
    /// Sets new values of some pixels.
    UpdateImage {
        /// The name of the image.
        name: String,
        /// True to show the image.
        focus: bool,
        /// The channels.
        channels: Vec<Channel>,
        /// The pixels, at least one.
        rect: PixelRect,
        /// The values, at least as many as the channels need.
        values: Vec<f32>,
    },
    /// Draws lines over an image.
    VectorGraphics {
        /// The name of the image.
        name: String,
        /// True to show the image.
        focus: bool,
        /// True to keep the lines that were drawn before.
        append: bool,
        /// The drawing commands.
        commands: Vec<Draw>,
    },
    /// Declares that the server supports the extension.
    Hello {
        /// The version of the extension.
        version: u32,
    },
    /// Marks pixels that are being rendered.
    Mark {
        /// The name of the image.
        name: String,
        /// The pixels, at least one.
        rect: PixelRect,
    },
    /// Sets how an image is shown.
    Wish {
        /// The name of the image.
        name: String,
        /// The display settings.
        wishes: Wishes,
    },
    /// Ends an image, for which no more data follows.
    Finished {
        /// The name of the image.
        name: String,
        /// True when the image is complete.
        complete: bool,
    },
    /// Shows a part of the controls beside an image.
    Panel {
        /// The name of the image.
        name: String,
        /// The name of the part.
        part: String,
        /// The content as JSON. It is empty to remove the part.
        text: String,
    },
    /// Reports to the renderer that a user used the panel.
    Edit {
        /// The name of the image.
        name: String,
        /// The edit as JSON, of at most [`EDIT_BYTES`].
        text: String,
    },
    /// A request of the viewer to the renderer.
    Request {
        /// The name of the image.
        name: String,
        /// The request.
        request: Request,
    },
}

impl Packet {
    /// Appends the packet's bytes to `out`, in the newest form of its kind.
    ///
    /// # Errors
    /// Returns [`DisplayError::Misuse`] when the protocol cannot express the packet: texts with zero bytes, sizes
    /// beyond `i32`, packets beyond `u32`. Nothing is appended then.
    pub fn encode(&self, out: &mut Vec<u8>) -> Result<()> {
        put(out, |put| put.packet(self))
    }

    /// Decodes a packet. `bytes` holds all of it, with its length. Bytes after its content are ignored, as other
    /// receivers do.
    ///
    /// # Errors
    /// Returns [`DisplayError::Malformed`], [`DisplayError::Unsupported`] or [`DisplayError::Limit`].
    pub fn decode(bytes: &[u8], limits: &PacketLimits) -> Result<Self> {
        let mut take = Take { bytes, at: 0, limits };
        let length = u32::from_le_bytes(take.array("its length")?);
        if length as usize != bytes.len() {
            return Err(take.wrong(format!("its length is {length}, and {} bytes came", bytes.len())));
        }
        take.packet()
    }
}

/// Checks the length with which a packet begins. Returns the number of bytes that follow it.
///
/// # Errors
/// Returns [`DisplayError::Malformed`] or [`DisplayError::Limit`]. The packets that follow cannot be found then.
pub fn rest_of(length: [u8; 4], limits: &PacketLimits) -> Result<usize> {
    let length = u32::from_le_bytes(length);
    if length < 5 {
        return Err(DisplayError::Malformed { what: format!("its length is {length}"), at: 0 });
    }
    within("bytes of a packet", u64::from(length), u64::from(limits.packet_bytes))?;
    Ok(length as usize - 4)
}

fn within(what: &'static str, asked: u64, max: u64) -> Result<()> {
    if asked <= max { Ok(()) } else { Err(DisplayError::Limit { what, asked, max }) }
}

/// The packet [`Packet::UpdateImage`] with borrowed data.
pub(crate) struct Update<'a> {
    pub(crate) name: &'a str,
    pub(crate) focus: bool,
    pub(crate) channels: &'a [Channel],
    pub(crate) rect: PixelRect,
    pub(crate) values: &'a [f32],
}

impl Update<'_> {
    /// Does the same as [`Packet::encode`].
    pub(crate) fn encode(&self, out: &mut Vec<u8>) -> Result<()> {
        put(out, |put| put.update(self))
    }
}

/// Appends a packet with its length. Appends nothing on an error.
fn put(out: &mut Vec<u8>, packet: impl FnOnce(&mut Put<'_>) -> Result<()>) -> Result<()> {
    let start = out.len();
    let done = packet(&mut Put { out, start });
    let length = out.len() - start;
    match (done, u32::try_from(length)) {
        (Ok(()), Ok(length)) => {
            out[start..start + 4].copy_from_slice(&length.to_le_bytes());
            Ok(())
        }
        (done, _) => {
            out.truncate(start);
            done.and(Err(DisplayError::Misuse { what: format!("a packet of {length} bytes") }))
        }
    }
}

/// Writes parts of packets.
struct Put<'a> {
    out: &'a mut Vec<u8>,
    start: usize,
}

impl Put<'_> {
    fn kind(&mut self, kind: u8) {
        debug_assert!(self.out.len() == self.start, "the type comes first");
        self.out.extend_from_slice(&[0, 0, 0, 0, kind]);
    }

    fn flag(&mut self, flag: bool) {
        self.out.push(u8::from(flag));
    }

    fn text(&mut self, text: &str) -> Result<()> {
        if text.contains('\0') {
            return Err(DisplayError::Misuse {
                what: format!("a zero byte in \"{}\"", text.escape_default()),
            });
        }
        self.out.extend_from_slice(text.as_bytes());
        self.out.push(0);
        Ok(())
    }

    fn int(&mut self, value: i32) {
        self.out.extend_from_slice(&value.to_le_bytes());
    }

    fn size(&mut self, size: usize) -> Result<()> {
        let size =
            i32::try_from(size).map_err(|_| DisplayError::Misuse { what: format!("a size of {size}") })?;
        self.int(size);
        Ok(())
    }

    fn long(&mut self, value: u64) -> Result<()> {
        let value = i64::try_from(value)
            .map_err(|_| DisplayError::Misuse { what: format!("an offset of {value}") })?;
        self.out.extend_from_slice(&value.to_le_bytes());
        Ok(())
    }

    fn rect(&mut self, rect: &PixelRect) -> Result<()> {
        if rect.is_empty() {
            return Err(DisplayError::Misuse { what: format!("no pixel in {rect:?}") });
        }
        self.int(rect.x0);
        self.int(rect.y0);
        self.size(rect.width())?;
        self.size(rect.height())
    }

    fn floats(&mut self, values: &[f32]) {
        let at = self.out.len();
        self.out.resize(at + 4 * values.len(), 0);
        for (to, v) in self.out[at..].as_chunks_mut().0.iter_mut().zip(values) {
            *to = v.to_le_bytes();
        }
    }

    fn update(&mut self, update: &Update<'_>) -> Result<()> {
        let Update { name, focus, channels, rect, values } = update;
        let needed = needed_values(channels, rect).filter(|needed| *needed <= values.len() as u64);
        let Some(needed) = needed else {
            let what = format!("{} values for the channels of {rect:?}", values.len());
            return Err(DisplayError::Misuse { what });
        };
        self.kind(6);
        self.flag(*focus);
        self.text(name)?;
        self.size(channels.len())?;
        channels.iter().try_for_each(|channel| self.text(&channel.name))?;
        self.rect(rect)?;
        channels.iter().try_for_each(|channel| self.long(channel.offset))?;
        channels.iter().try_for_each(|channel| self.long(channel.stride))?;
        // Other receivers require exactly as many values as are used.
        self.floats(&values[..needed as usize]);
        Ok(())
    }

    fn packet(&mut self, packet: &Packet) -> Result<()> {
        match packet {
            Packet::OpenImage { path, selector, focus } => {
                self.kind(7);
                self.flag(*focus);
                self.text(path)?;
                self.text(selector)
            }
            Packet::ReloadImage { name, focus } => {
                self.kind(1);
                self.flag(*focus);
                self.text(name)
            }
            Packet::CloseImage { name } => {
                self.kind(2);
                self.text(name)
            }
            Packet::CreateImage { name, focus, width, height, channels } => {
                self.kind(4);
                self.flag(*focus);
                self.text(name)?;
                self.size(*width as usize)?;
                self.size(*height as usize)?;
                self.size(channels.len())?;
                channels.iter().try_for_each(|channel| self.text(channel))
            }
            Packet::UpdateImage { name, focus, channels, rect, values } => {
                self.update(&Update { name, focus: *focus, channels, rect: *rect, values })
            }
            Packet::VectorGraphics { name, focus, append, commands } => {
                self.kind(8);
                self.flag(*focus);
                self.text(name)?;
                self.flag(*append);
                self.size(commands.len())?;
                commands.iter().for_each(|command| self.vector(command));
                Ok(())
            }
            Packet::Hello { version } => {
                self.kind(100);
                self.out.extend_from_slice(&version.to_le_bytes());
                Ok(())
            }
            Packet::Mark { name, rect } => {
                self.kind(101);
                self.text(name)?;
                self.rect(rect)
            }
            Packet::Wish { name, wishes } => {
                self.kind(102);
                self.text(name)?;
                self.flag(wishes.fullscreen);
                self.out.extend_from_slice(&wishes.zoom.to_le_bytes());
                self.text(&wishes.foreground)?;
                self.text(&wishes.background)
            }
            Packet::Finished { name, complete } => {
                self.kind(103);
                self.text(name)?;
                self.flag(*complete);
                Ok(())
            }
            Packet::Panel { name, part, text } => {
                self.kind(104);
                self.text(name)?;
                self.text(part)?;
                self.text(text)
            }
            Packet::Edit { name, text } => {
                if text.len() > EDIT_BYTES {
                    return Err(DisplayError::Misuse { what: format!("an edit of {} bytes", text.len()) });
                }
                self.kind(113);
                self.text(name)?;
                self.text(text)
            }
            Packet::Request { name, request } => {
                self.kind(match request {
                    Request::Center { .. } => 110,
                    Request::Priority(_) => 111,
                    Request::Abort => 112,
                });
                self.text(name)?;
                match request {
                    Request::Center { x, y } => {
                        self.int(*x);
                        self.int(*y);
                        Ok(())
                    }
                    Request::Priority(rect) => self.rect(rect),
                    Request::Abort => Ok(()),
                }
            }
        }
    }

    fn vector(&mut self, command: &Draw) {
        let (kind, values): (u8, &[f32]) = match command {
            Draw::Save => (0, &[]),
            Draw::Restore => (1, &[]),
            Draw::MoveTo(point) => (2, point),
            Draw::LineTo(point) => (3, point),
            Draw::FillColor(color) => (4, color),
            Draw::StrokeColor(color) => (5, color),
            Draw::Fill => (6, &[]),
            Draw::Stroke => (7, &[]),
            Draw::BeginPath => (8, &[]),
        };
        self.out.push(kind);
        self.floats(values);
    }
}

/// The number of values that the channels use; `None` when it does not fit in 64 bits.
fn needed_values(channels: &[Channel], rect: &PixelRect) -> Option<u64> {
    let last = rect.pixels().checked_sub(1)?;
    channels.iter().try_fold(0_u64, |most, channel| {
        let end = last.checked_mul(channel.stride)?.checked_add(channel.offset)?.checked_add(1)?;
        Some(most.max(end))
    })
}

/// Reads parts of packets.
struct Take<'a> {
    bytes: &'a [u8],
    at: usize,
    limits: &'a PacketLimits,
}

impl Take<'_> {
    fn wrong(&self, what: impl Into<String>) -> DisplayError {
        DisplayError::Malformed { what: what.into(), at: self.at }
    }

    fn array<const N: usize>(&mut self, what: &str) -> Result<[u8; N]> {
        let bytes = self.bytes.get(self.at..).and_then(|rest| rest.first_chunk::<N>());
        let bytes = *bytes.ok_or_else(|| self.wrong(format!("{what} is missing")))?;
        self.at += N;
        Ok(bytes)
    }

    fn flag(&mut self, what: &str) -> Result<bool> {
        self.array::<1>(what).map(|[byte]| byte == 1)
    }

    /// Reads a text. Bytes that are not UTF-8 are replaced, because other programs send the encoding of their system.
    fn text(&mut self, what: &str) -> Result<String> {
        self.text_within(what, self.limits.text_bytes)
    }

    /// Reads a text of at most `most` bytes.
    fn text_within(&mut self, what: &str, most: usize) -> Result<String> {
        let rest = &self.bytes[self.at..];
        let searched = &rest[..rest.len().min(most.saturating_add(1))];
        match searched.iter().position(|b| *b == 0) {
            Some(length) => {
                self.at += length + 1;
                Ok(String::from_utf8_lossy(&rest[..length]).into_owned())
            }
            None => {
                within("bytes of a text", rest.len() as u64, most as u64)?;
                Err(self.wrong(format!("{what} has no end")))
            }
        }
    }

    fn int(&mut self, what: &str) -> Result<i32> {
        self.array(what).map(i32::from_le_bytes)
    }

    fn word(&mut self, what: &str) -> Result<u32> {
        self.array(what).map(u32::from_le_bytes)
    }

    /// Reads a number of elements, at least 0.
    fn count(&mut self, what: &'static str, max: u32) -> Result<u32> {
        let count = self.int(what)?;
        let count = u32::try_from(count).map_err(|_| self.wrong(format!("{what} is {count}")))?;
        within(what, u64::from(count), u64::from(max))?;
        Ok(count)
    }

    /// Reads a side of an image, at least 1.
    fn side(&mut self, what: &'static str) -> Result<u32> {
        match self.count(what, self.limits.dimension)? {
            0 => Err(self.wrong(format!("{what} is 0"))),
            side => Ok(side),
        }
    }

    fn rect(&mut self) -> Result<PixelRect> {
        let (x, y) = (self.int("column")?, self.int("row")?);
        let (width, height) = (self.side("width")?, self.side("height")?);
        if x.checked_add_unsigned(width).is_none() || y.checked_add_unsigned(height).is_none() {
            return Err(self.wrong(format!("{width} x {height} pixels from {x}, {y}")));
        }
        Ok(PixelRect::at(x, y, width, height))
    }

    fn channels(&mut self) -> Result<Vec<String>> {
        let count = self.count("number of channels", self.limits.channels)?;
        (0..count).map(|_| self.text("a channel's name")).collect()
    }

    /// Reads a number from 0 to 2^63 - 1.
    fn long(&mut self, what: &str) -> Result<u64> {
        let value = i64::from_le_bytes(self.array(what)?);
        u64::try_from(value).map_err(|_| self.wrong(format!("{what} is {value}")))
    }

    fn floats(&mut self, count: u64) -> Result<Vec<f32>> {
        let rest = &self.bytes[self.at..];
        let bytes = usize::try_from(count).ok().and_then(|n| n.checked_mul(4));
        let Some(bytes) = bytes.and_then(|n| rest.get(..n)) else {
            return Err(self.wrong(format!("{count} values are needed, and {} bytes came", rest.len())));
        };
        self.at += bytes.len();
        Ok(bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect())
    }

    fn packet(&mut self) -> Result<Packet> {
        let [kind] = self.array("its type")?;
        Ok(match kind {
            0 | 7 => {
                let focus = self.flag("the focus")?;
                let text = self.text("the path")?;
                let (path, selector) = match kind {
                    0 => path_and_selector(&text),
                    _ => (text, self.text("the selector")?),
                };
                Packet::OpenImage { path, selector, focus }
            }
            1 => {
                let focus = self.flag("the focus")?;
                Packet::ReloadImage { name: self.text("the name")?, focus }
            }
            2 => Packet::CloseImage { name: self.text("the name")? },
            3 | 5 | 6 => self.update(kind)?,
            4 => {
                let focus = self.flag("the focus")?;
                let name = self.text("the name")?;
                let (width, height) = (self.side("width")?, self.side("height")?);
                Packet::CreateImage { name, focus, width, height, channels: self.channels()? }
            }
            8 => {
                let focus = self.flag("the focus")?;
                let name = self.text("the name")?;
                let append = self.flag("whether to append")?;
                let count = self.count("number of commands", self.limits.commands)?;
                let commands = (0..count).map(|_| self.vector()).collect::<Result<_>>()?;
                Packet::VectorGraphics { name, focus, append, commands }
            }
            100 => Packet::Hello { version: self.word("the version")? },
            101 => Packet::Mark { name: self.text("the name")?, rect: self.rect()? },
            102 => Packet::Wish {
                name: self.text("the name")?,
                wishes: Wishes {
                    fullscreen: self.flag("fullscreen")?,
                    zoom: self.word("the zoom")?,
                    foreground: self.text("the foreground")?,
                    background: self.text("the background")?,
                },
            },
            103 => {
                Packet::Finished { name: self.text("the name")?, complete: self.flag("whether complete")? }
            }
            104 => Packet::Panel {
                name: self.text("the name")?,
                part: self.text("the part")?,
                text: self.text_within("the panel", self.limits.panel_bytes)?,
            },
            113 => {
                Packet::Edit { name: self.text("the name")?, text: self.text_within("the edit", EDIT_BYTES)? }
            }
            110..=112 => {
                let name = self.text("the name")?;
                let request = match kind {
                    110 => Request::Center { x: self.int("x")?, y: self.int("y")? },
                    111 => Request::Priority(self.rect()?),
                    _ => Request::Abort,
                };
                Packet::Request { name, request }
            }
            kind => return Err(DisplayError::Unsupported { kind }),
        })
    }

    fn update(&mut self, kind: u8) -> Result<Packet> {
        let focus = self.flag("the focus")?;
        let name = self.text("the name")?;
        let names = match kind {
            3 => vec![self.text("the channel")?],
            _ => self.channels()?,
        };
        let rect = self.rect()?;
        let planar = |(i, name)| Channel { name, offset: i as u64 * rect.pixels(), stride: 1 };
        let mut channels: Vec<Channel> = names.into_iter().enumerate().map(planar).collect();
        if kind == 6 {
            for channel in &mut channels {
                channel.offset = self.long("an offset")?;
            }
            for channel in &mut channels {
                channel.stride = self.long("a stride")?;
            }
        }
        let needed = needed_values(&channels, &rect)
            .ok_or_else(|| self.wrong("an offset is beyond what numbers hold"))?;
        Ok(Packet::UpdateImage { name, focus, channels, rect, values: self.floats(needed)? })
    }

    fn vector(&mut self) -> Result<Draw> {
        let [kind] = self.array("a command")?;
        let mut floats = |n| self.floats(n);
        let mut point = || floats(2).map(|v| [v[0], v[1]]);
        Ok(match kind {
            0 => Draw::Save,
            1 => Draw::Restore,
            2 => Draw::MoveTo(point()?),
            3 => Draw::LineTo(point()?),
            4 | 5 => {
                let v = floats(4)?;
                let color = [v[0], v[1], v[2], v[3]];
                if kind == 4 { Draw::FillColor(color) } else { Draw::StrokeColor(color) }
            }
            6 => Draw::Fill,
            7 => Draw::Stroke,
            8 => Draw::BeginPath,
            other => return Err(self.wrong(format!("a command of type {other}"))),
        })
    }
}

/// Splits "path:selector". The colon of a drive does not begin a selector.
fn path_and_selector(text: &str) -> (String, String) {
    match text.rsplit_once(':') {
        Some((drive, rest)) if drive.len() == 1 && rest.starts_with(['/', '\\']) => {
            (text.to_owned(), String::new())
        }
        Some((path, selector)) => (path.to_owned(), selector.to_owned()),
        None => (text.to_owned(), String::new()),
    }
}

#[cfg(test)]
mod tests;
