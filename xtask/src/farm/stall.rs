//! Frames whose network stalls for a minute. The workers are in a network namespace of their own.

use super::local::{References, compare_large, gelato};
use super::place::{LARGE, Place, Running, output, secret, wait};
use std::fs;
use std::net::TcpStream;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The time for which the network stalls.
const STALL: Duration = Duration::from_secs(60);

/// The hardware addresses of the ends of the link, and one that no interface has.
const NEAR: &str = "02:00:c6:12:00:01";
const FAR: &str = "02:00:c6:12:00:02";
const NOBODY: &str = "02:00:c6:12:00:03";

/// The port of the coordinator.
const PORT: u16 = 14160;

/// A network namespace, and a link to it. Both are removed at the end.
struct Network {
    name: String,
    /// The interfaces at both ends.
    links: [String; 2],
    /// The addresses at both ends.
    addresses: [String; 2],
}

/// Returns the reason why there can be no network.
pub(super) fn missing() -> Option<String> {
    let is_root = fs::metadata("/proc/self").is_ok_and(|data| data.uid() == 0);
    if !is_root {
        return Some("only root can make network namespaces".to_owned());
    }
    match Network::new() {
        Ok(network) => network.check().err(),
        Err(what) => Some(format!("this system makes no network namespaces: {what}")),
    }
}

impl Network {
    fn new() -> Result<Self, String> {
        let id = std::process::id();
        let (links, block) = ([format!("gr{id}a"), format!("gr{id}b")], (id / 64 % 256, id % 64 * 4));
        // A block of addresses for tests of networks (RFC 2544).
        let addresses = [1, 2].map(|end| format!("198.18.{}.{}", block.0, block.1 + end));
        let network = Self { name: format!("granita-{id}"), links, addresses };
        let Self { name, links: [near, far], addresses: [here, there] } = &network;
        ip(&format!("netns add {name}"))?;
        ip(&format!("link add {near} address {NEAR} type veth peer name {far} address {FAR} netns {name}"))?;
        ip(&format!("addr add {here}/30 dev {near}"))?;
        ip(&format!("link set {near} up"))?;
        ip(&format!("-n {name} addr add {there}/30 dev {far}"))?;
        ip(&format!("-n {name} link set {far} up"))?;
        ip(&format!("-n {name} link set lo up"))?;
        network.stall(false)?;
        Ok(network)
    }

    /// Sends all packets of both directions to an address that no interface has, so that they are lost silently, or to
    /// the right ones again.
    fn stall(&self, stalls: bool) -> Result<(), String> {
        let Self { name, links: [near, far], addresses: [here, there] } = self;
        let to = |address: &'static str| if stalls { NOBODY } else { address };
        ip(&format!("neigh replace {there} lladdr {} dev {near} nud permanent", to(FAR)))?;
        ip(&format!("-n {name} neigh replace {here} lladdr {} dev {far} nud permanent", to(NEAR)))
    }

    /// Checks that packets pass and are lost.
    fn check(&self) -> Result<(), String> {
        let listener = std::net::TcpListener::bind((&*self.addresses[0], 0)).map_err(|e| e.to_string())?;
        let port = listener.local_addr().map_err(|error| error.to_string())?.port();
        let connects = || {
            let script = format!("exec 3<>/dev/tcp/{}/{port}", self.addresses[0]);
            let mut command = self.command("timeout");
            command.args(["2", "bash", "-c", &script]).stdout(Stdio::null()).stderr(Stdio::null());
            command.status().is_ok_and(|status| status.success())
        };
        if !connects() {
            return Err("the network namespace has no connection".to_owned());
        }
        self.stall(true)?;
        if connects() { Err("the link does not stall".to_owned()) } else { Ok(()) }
    }

    /// Returns a command that runs in the namespace.
    fn command(&self, program: &str) -> Command {
        let mut command = Command::new("ip");
        command.args(["netns", "exec", &self.name, program]);
        command
    }
}

impl Drop for Network {
    fn drop(&mut self) {
        // The link goes with the namespace, unless it was made only in part.
        let _ = ip(&format!("link del {}", self.links[0]));
        let _ = ip(&format!("netns del {}", self.name));
    }
}

/// Runs the program `ip`.
fn ip(words: &str) -> Result<(), String> {
    let mut command = Command::new("ip");
    command.args(words.split_whitespace());
    output(command).map(|_| ())
}

/// Renders the large frame with two workers behind a network that stalls for a minute, then with one of them on this
/// side.
pub(super) fn run(place: &Place, references: &References) -> Result<(), String> {
    let network = Network::new()?;
    for (what, near) in [("all workers", 0), ("one of two workers", 1)] {
        let folder = place.job(&format!("stall-{near}"))?;
        frame(place, references, &network, &folder, near)
            .map_err(|error| format!("a network of {what} that stalls: {error}"))?;
    }
    Ok(())
}

/// Renders the frame with `near` workers on this side of the network, and the rest of two beyond it.
fn frame(
    place: &Place,
    references: &References,
    network: &Network,
    folder: &Path,
    near: usize,
) -> Result<(), String> {
    super::local::maps(place, folder)?;
    let secret = secret(folder)?;
    let (host, address) = (&network.addresses[0], format!("{}:{PORT}", network.addresses[0]));
    let started =
        |mut command: Command| command.spawn().map(Running).map_err(|error| format!("gelato: {error}"));
    let begin = Instant::now();
    let net = format!("listen:{address}");
    let mut coordinator = started(gelato(place, folder, &["-net", &net, "-secret", &secret, LARGE]))?;
    wait("the coordinator", || Ok(TcpStream::connect((&**host, PORT)).is_ok()))?;
    let workers: Result<Vec<Running>, String> = (0..2)
        .map(|worker| {
            let words = ["-silent", "-threads", "1", "-worker", "-join", &address, "-secret", &secret];
            let own = place.bins.join("gelato");
            let mut command =
                if worker < near { Command::new(own) } else { network.command(&own.to_string_lossy()) };
            command.args(words).current_dir(folder).stdin(Stdio::null()).env_remove("GELATOHOME");
            started(command)
        })
        .collect();
    let mut workers = workers?;
    std::thread::sleep(Duration::from_millis(700) + references.large_time / 8);
    let stalled = Instant::now();
    network.stall(true)?;
    if coordinator.0.try_wait().map_err(|error| error.to_string())?.is_some() {
        println!("farm: the frame was complete before the network stalled");
    }
    let status = coordinator.0.wait().map_err(|error| error.to_string())?;
    let late = begin.elapsed().saturating_sub(references.large_time);
    if !status.success() {
        return Err(status.to_string());
    }
    compare_large(&format!("a network that stalls, {near} of two workers on this side"), folder, references)?;
    println!("farm: {:.1} s later than one process", late.as_secs_f64());
    if late > Duration::from_secs(10) {
        return Err("that is too late".to_owned());
    }
    std::thread::sleep(STALL.saturating_sub(stalled.elapsed()));
    network.stall(false)?;
    wait("the ends of the workers", || {
        let ended = workers.iter_mut().map(|worker| worker.0.try_wait());
        let ended: Result<Vec<_>, _> = ended.collect();
        Ok(ended.map_err(|error| error.to_string())?.iter().all(Option::is_some))
    })?;
    println!("farm: the workers ended {:.0} s after the network stalled", stalled.elapsed().as_secs_f64());
    Ok(())
}
