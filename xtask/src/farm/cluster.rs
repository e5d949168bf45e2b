//! A cluster of Slurm on this machine.

use super::place::{Place, Running, output, wait};
use std::fs;
use std::net::TcpListener;
use std::os::unix::fs::{MetadataExt, PermissionsExt};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The programs that are needed, and their packages in Debian.
const PROGRAMS: [(&str, &str); 6] = [
    ("slurmctld", "slurm-wlm"),
    ("slurmd", "slurm-wlm"),
    ("sbatch", "slurm-wlm"),
    ("srun", "slurm-wlm"),
    ("munged", "munge"),
    ("unshare", "util-linux"),
];

/// The folders of programs of the system.
const FOLDERS: [&str; 4] = ["/usr/sbin", "/usr/bin", "/usr/local/sbin", "/usr/local/bin"];

/// The daemons of a cluster. All end with it.
pub(super) struct Cluster<'a> {
    place: &'a Place,
    folder: PathBuf,
    /// The daemon of each node, in its own space of process numbers; `None` for a node that was killed.
    nodes: Vec<Option<Running>>,
    /// The other daemons.
    _daemons: Vec<Running>,
}

impl<'a> Cluster<'a> {
    /// Returns the reason why there can be no cluster.
    pub(super) fn missing() -> Option<String> {
        let found = |name: &str| FOLDERS.iter().any(|folder| Path::new(folder).join(name).is_file());
        if let Some((name, package)) = PROGRAMS.iter().find(|(name, _)| !found(name)) {
            return Some(format!("there is no {name} (apt-get install {package}, or --install)"));
        }
        let is_root = fs::metadata("/proc/self").is_ok_and(|data| data.uid() == 0);
        if !is_root {
            return Some("only root can start nodes".to_owned());
        }
        let mut spaces = Command::new("unshare");
        spaces.args(["--pid", "--fork", "--mount-proc", "--kill-child", "true"]).stderr(Stdio::null());
        let has_spaces = spaces.status().is_ok_and(|status| status.success());
        (!has_spaces).then(|| "this system makes no spaces of process numbers (unshare --pid)".to_owned())
    }

    /// Starts a cluster of nodes with a number of cores each.
    pub(super) fn start(place: &'a Place, name: &str, nodes: usize, cores: usize) -> Result<Self, String> {
        let folder = place.scratch.join(name);
        let told = |error: std::io::Error| format!("{}: {error}", folder.display());
        fs::create_dir_all(folder.join("state")).map_err(told)?;
        // The sockets of munge must be reachable, and its key private.
        fs::set_permissions(&folder, PermissionsExt::from_mode(0o755)).map_err(told)?;
        let key = folder.join("munge.key");
        let random = fs::File::open("/dev/urandom").and_then(|mut file| {
            let mut bytes = [0; 64];
            std::io::Read::read_exact(&mut file, &mut bytes).map(|()| bytes)
        });
        fs::write(&key, random.map_err(told)?).map_err(told)?;
        fs::set_permissions(&key, PermissionsExt::from_mode(0o400)).map_err(told)?;
        fs::write(folder.join("slurm.conf"), settings(&folder, nodes, cores)?).map_err(told)?;
        let mut cluster = Self { place, folder, nodes: Vec::new(), _daemons: Vec::new() };
        let at = |name: &str| cluster.folder.join(name).display().to_string();
        let munged = cluster.daemon(
            "munged",
            &[
                "--foreground".to_owned(),
                "--force".to_owned(),
                format!("--socket={}", at("munge.socket")),
                format!("--key-file={}", at("munge.key")),
                format!("--log-file={}", at("munged.log")),
                format!("--pid-file={}", at("munged.pid")),
                format!("--seed-file={}", at("munged.seed")),
            ],
        )?;
        let socket = cluster.folder.join("munge.socket");
        wait("munged", || Ok(socket.exists()))?;
        let controller = cluster.daemon("slurmctld", &["-D".to_owned()])?;
        cluster._daemons = vec![controller, munged];
        for node in 0..nodes {
            cluster.nodes.push(None);
            cluster.start_node(node)?;
        }
        wait("the nodes", || Ok(cluster.idle() == nodes))?;
        Ok(cluster)
    }

    fn daemon(&self, program: &str, words: &[String]) -> Result<Running, String> {
        let log = self.folder.join(format!("{program}.out"));
        let log = fs::File::create(&log).map_err(|error| format!("{}: {error}", log.display()))?;
        let found = FOLDERS.iter().map(|folder| Path::new(folder).join(program)).find(|path| path.is_file());
        let mut command = self.command(&found.unwrap_or_else(|| program.into()).to_string_lossy());
        let second = log.try_clone().map_err(|error| error.to_string())?;
        command.args(words).stdout(log).stderr(second);
        command.spawn().map(Running).map_err(|error| format!("{program}: {error}"))
    }

    /// Returns a command that talks to the cluster.
    pub(super) fn command(&self, program: &str) -> Command {
        self.command_in(program, &self.folder)
    }

    /// Returns a command that talks to the cluster, in a folder.
    pub(super) fn command_in(&self, program: &str, folder: &Path) -> Command {
        let mut command = self.place.command(program, folder);
        command.env("SLURM_CONF", self.folder.join("slurm.conf"));
        command
    }

    /// Starts the daemon of a node.
    pub(super) fn start_node(&mut self, node: usize) -> Result<(), String> {
        let words = ["--pid", "--fork", "--mount-proc", "--kill-child", "slurmd", "-D", "-N", &name(node)];
        let words: Vec<String> = words.iter().map(|word| (*word).to_owned()).collect();
        self.nodes[node] = Some(self.daemon("unshare", &words)?);
        Ok(())
    }

    /// Kills the daemon of a node, and with it all processes of the node.
    pub(super) fn kill_node(&mut self, node: usize) {
        self.nodes[node] = None;
    }

    /// Returns the number of nodes that wait for work.
    fn idle(&self) -> usize {
        let mut command = self.command("sinfo");
        command.args(["--noheader", "--Node", "--states", "idle", "--format", "%N"]);
        // The controller may not listen yet.
        output(command).map_or(0, |text| text.lines().filter(|line| !line.trim().is_empty()).count())
    }

    /// Returns the task of the array `step` that runs on a node.
    pub(super) fn task_on(&self, node: usize, step: &str) -> Result<Option<u32>, String> {
        let mut command = self.command("squeue");
        command.args(["--noheader", "--states", "R", "--nodelist", &name(node), "--format", "%j %K"]);
        let text = output(command)?;
        let found = text.lines().find_map(|line| line.trim().strip_prefix(step)?.trim().parse().ok());
        Ok(found)
    }

    /// Waits until no job is left, and returns the number of tasks that completed.
    pub(super) fn finish(&self) -> Result<usize, String> {
        wait("the jobs", || {
            let mut command = self.command("squeue");
            command.args(["--noheader", "--format", "%i %r"]);
            let text = output(command)?;
            // Slurm lets tasks of a lost node wait for two minutes.
            for task in text.lines().filter_map(|line| line.trim().strip_suffix("BeginTime")) {
                let mut command = self.command("scontrol");
                command.args(["update", &format!("JobId={}", task.trim()), "StartTime=now"]);
                output(command)?;
            }
            Ok(text.trim().is_empty())
        })?;
        let mut command = self.command("scontrol");
        command.args(["show", "job", "--oneliner"]);
        let text = output(command)?;
        let state = |line: &str| {
            let word = line.split_whitespace().find_map(|word| word.strip_prefix("JobState="));
            word.unwrap_or_default().to_owned()
        };
        let states: Vec<String> = text.lines().map(state).collect();
        match text.lines().find(|line| state(line) != "COMPLETED") {
            Some(line) => Err(format!("a task is {}: {line}", state(line))),
            None => Ok(states.len()),
        }
    }
}

/// Returns the name of a node.
fn name(node: usize) -> String {
    format!("node{}", node + 1)
}

/// Returns the text of slurm.conf.
fn settings(folder: &Path, nodes: usize, cores: usize) -> Result<String, String> {
    let told = |error: std::io::Error| error.to_string();
    let host = fs::read_to_string("/proc/sys/kernel/hostname").map_err(told)?;
    let host = host.trim();
    // All are kept until all are known, so that they differ.
    let listeners: Result<Vec<TcpListener>, String> =
        (0..=nodes).map(|_| TcpListener::bind("127.0.0.1:0").map_err(told)).collect();
    let ports: Result<Vec<u16>, String> =
        listeners?.iter().map(|one| one.local_addr().map(|at| at.port()).map_err(told)).collect();
    let ports = ports?;
    let at = folder.display();
    let mut text = format!(
        "ClusterName=granita\nSlurmctldHost={host}(127.0.0.1)\nSlurmctldPort={}\nSlurmUser=root\nSlurmdUser=root\n\
         AuthType=auth/munge\nAuthInfo=socket={at}/munge.socket\nStateSaveLocation={at}/state\nSlurmdSpoolDir={at}/spool-%n\n\
         SlurmctldPidFile={at}/slurmctld.pid\nSlurmdPidFile={at}/slurmd-%n.pid\nSlurmctldLogFile={at}/slurmctld.log\n\
         SlurmdLogFile={at}/slurmd-%n.log\nProctrackType=proctrack/pgid\nTaskPlugin=task/none\nSelectType=select/cons_tres\n\
         SelectTypeParameters=CR_Core\nReturnToService=2\nSlurmdTimeout=5\nKillWait=2\nMinJobAge=3600\nMpiDefault=none\n\
         SchedulerParameters=sched_interval=1,batch_sched_delay=1\nSlurmdParameters=config_overrides\n",
        ports[0]
    );
    for node in 0..nodes {
        let (name, port) = (name(node), ports[node + 1]);
        text += &format!(
            "NodeName={name} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} CPUs={cores} State=UNKNOWN\n"
        );
    }
    Ok(text + "PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP\n")
}
