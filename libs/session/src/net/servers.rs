//! The words of "-net" and "net:workers", which say where workers are.

use crate::secret::NetSecret;
use std::io;
use std::path::Path;

/// Reads a file as text.
type ReadFile<'a> = &'a dyn Fn(&Path) -> io::Result<String>;

/// Where workers come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Server {
    /// A worker that is started on a machine, "local" for this one, through `ssh` otherwise.
    Start(String),
    /// Workers that connect to a port of this machine, of all addresses where none is given.
    Listen { host: String, port: u16 },
    /// The command that starts workers, which connect to this machine. [`Launch::words`] puts the worker's command in.
    Launch(Launch),
}

/// A command that starts workers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Launch {
    /// The words, for messages.
    pub(crate) name: String,
    /// The words before those of the worker. "%h" is replaced by the address that it connects to.
    prefix: Vec<String>,
    /// True when the command is the whole: no words of a worker follow.
    is_whole: bool,
    /// The environment variables of the command.
    pub(crate) variables: &'static [(&'static str, &'static str)],
}

/// Makes Open MPI keep the other workers when one fails.
const OPEN_MPI: &[(&str, &str)] =
    &[("OMPI_MCA_orte_enable_recovery", "1"), ("OMPI_MCA_orte_abort_on_non_zero_status", "0")];

impl Launch {
    fn new(name: &str, prefix: &[&str]) -> Self {
        let prefix = prefix.iter().map(|word| (*word).to_owned()).collect();
        Self { name: name.to_owned(), prefix, is_whole: false, variables: &[] }
    }

    /// Returns the words of the command. `address` is that of the coordinator, and `worker` are the words that start
    /// `gelato` on the machines.
    pub(crate) fn words(&self, address: &str, worker: &[String]) -> Vec<String> {
        let mut words: Vec<String> = self.prefix.iter().map(|word| word.replace("%h", address)).collect();
        if !self.is_whole {
            words.extend(worker.iter().cloned());
            words.extend(["-worker", "-join", address].map(str::to_owned));
        }
        words
    }
}

/// Reads the lists of "-net", or that of "net:workers". An entry that begins with "cmd:" is a command and reaches to
/// the end of its list; other entries are separated by blanks.
///
/// # Errors
/// Returns a message that names the wrong entry.
pub(crate) fn parse<'a>(
    lists: impl IntoIterator<Item = &'a str>,
    read: ReadFile<'_>,
) -> Result<Vec<Server>, String> {
    let mut servers = Vec::new();
    for list in lists {
        let mut rest = list.trim_start();
        while !rest.is_empty() {
            if let Some(command) = rest.strip_prefix("cmd:") {
                servers.push(Server::Launch(command_line(command)?));
                break;
            }
            let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
            servers.extend(entry(&rest[..end], read)?);
            rest = rest[end..].trim_start();
        }
    }
    Ok(servers)
}

/// Reads the command of "cmd:".
fn command_line(text: &str) -> Result<Launch, String> {
    let words: Vec<&str> = text.split_whitespace().collect();
    if words.is_empty() {
        return Err("\"cmd:\" needs a command that starts workers".to_owned());
    }
    Ok(Launch { is_whole: text.contains("%h"), ..Launch::new(words[0], &words) })
}

/// Reads an entry without blanks.
fn entry(word: &str, read: ReadFile<'_>) -> Result<Vec<Server>, String> {
    let count = |text: &str| match text.parse::<u32>() {
        Ok(n @ 1..=100_000) => Ok(n.to_string()),
        _ => Err(format!("\"{word}\": expected a number of workers from 1 to 100000")),
    };
    Ok(match word.split_once(':') {
        Some(("slurm", n)) => {
            // A node that fails costs its own workers only.
            let prefix = ["srun", "-n", &count(n)?, "--export=ALL", "--no-kill", "--kill-on-bad-exit=0"];
            vec![Server::Launch(Launch::new(word, &prefix))]
        }
        Some(("mpi", n)) => {
            let words = ["mpirun", "-n", &count(n)?, "-x", NetSecret::VARIABLE];
            vec![Server::Launch(Launch { variables: OPEN_MPI, ..Launch::new(word, &words) })]
        }
        Some(("hosts", file)) => hosts(Path::new(file), read)?,
        Some(("listen", place)) => vec![listen(word, place)?],
        _ if word == "listen" => vec![Server::Listen { host: String::new(), port: 0 }],
        _ => vec![Server::Start(word.to_owned())],
    })
}

/// Reads the place of "listen:PLACE", which is PORT or HOST:PORT.
fn listen(word: &str, place: &str) -> Result<Server, String> {
    let (host, port) = place.rsplit_once(':').unwrap_or(("", place));
    let port =
        port.parse().map_err(|_| format!("\"{word}\": expected listen, listen:PORT or listen:HOST:PORT"))?;
    Ok(Server::Listen { host: host.trim_start_matches('[').trim_end_matches(']').to_owned(), port })
}

/// Reads a file of machines: a name in each line, and the number of workers there, as a second word or as
/// "slots=NUMBER". Text after "#" is skipped.
fn hosts(file: &Path, read: ReadFile<'_>) -> Result<Vec<Server>, String> {
    let text = read(file).map_err(|error| format!("{}: {error}", file.display()))?;
    let mut servers = Vec::new();
    for (number, line) in text.lines().enumerate() {
        let mut words = line.split('#').next().unwrap_or_default().split_whitespace();
        let Some(host) = words.next() else { continue };
        let count = words.next().map_or(Ok(1), |word| word.trim_start_matches("slots=").parse::<usize>());
        match count {
            Ok(count @ 1..=4096) if words.next().is_none() => {
                servers.extend(std::iter::repeat_n(Server::Start(host.to_owned()), count));
            }
            _ => return Err(format!("{}:{}: expected HOST [NUMBER]", file.display(), number + 1)),
        }
    }
    if servers.is_empty() { Err(format!("{}: it names no machine", file.display())) } else { Ok(servers) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed<'a>(lists: impl IntoIterator<Item = &'a str>) -> Result<Vec<Server>, String> {
        parse(lists, &|file| std::fs::read_to_string(file))
    }

    fn start(name: &str) -> Server {
        Server::Start(name.to_owned())
    }

    #[test]
    fn words_name_machines_ports_and_commands() {
        assert_eq!(parsed(["local alpha", " beta "]).unwrap(), ["local", "alpha", "beta"].map(start));
        let listen = |host: &str, port| Server::Listen { host: host.to_owned(), port };
        assert_eq!(
            parsed(["listen listen:7000 listen:[::1]:9 local"]).unwrap(),
            [listen("", 0), listen("", 7000), listen("::1", 9), start("local")]
        );
        let worker = ["gelato".to_owned()];
        let words = |list: &str| match &parsed([list]).unwrap()[..] {
            [Server::Launch(launch)] => launch.words("here:80", &worker).join(" "),
            other => panic!("{other:?}"),
        };
        assert_eq!(
            words("slurm:8"),
            "srun -n 8 --export=ALL --no-kill --kill-on-bad-exit=0 gelato -worker -join here:80"
        );
        assert_eq!(words("mpi:2"), "mpirun -n 2 -x GRANITA_NET_SECRET gelato -worker -join here:80");
        assert_eq!(words("cmd:bsub -n 4 sh"), "bsub -n 4 sh gelato -worker -join here:80");
        assert_eq!(words("cmd:start-workers --at %h 3"), "start-workers --at here:80 3");
    }

    #[test]
    fn wrong_words_are_named() {
        for (list, part) in [
            ("slurm:none", "\"slurm:none\": expected a number of workers"),
            ("mpi:0", "\"mpi:0\""),
            ("listen:port", "\"listen:port\": expected listen,"),
            ("cmd: ", "needs a command"),
            ("hosts:/nowhere/hosts", "/nowhere/hosts: "),
        ] {
            let error = parsed([list]).unwrap_err();
            assert!(error.contains(part), "{list}: {error}");
        }
    }

    #[test]
    fn files_of_hosts_have_a_machine_in_each_line() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("hosts");
        std::fs::write(&file, "# the room\nalpha 2\n\nbeta slots=1 # old\ngamma\n").unwrap();
        let list = format!("hosts:{}", file.display());
        assert_eq!(parsed([&*list]).unwrap(), ["alpha", "alpha", "beta", "gamma"].map(start));
        std::fs::write(&file, "alpha\nbeta many\n").unwrap();
        assert!(parsed([&*list]).unwrap_err().ends_with("hosts:2: expected HOST [NUMBER]"));
        std::fs::write(&file, "\n").unwrap();
        assert!(parsed([&*list]).unwrap_err().ends_with("it names no machine"));
    }
}
