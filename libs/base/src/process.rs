//! The activities of a run, and the child processes that it started. Both are stored in one place, so that a run can
//! be ended.
//!
//! Every child process is the leader of its own process group (on Unix). [`Supervisor::end`] ends the groups,
//! including the children of children. When this process is killed, it can no longer do that. A *guard*, a small
//! shell that is started with the first child, then detects the end of its connection and ends the groups instead. A
//! child whose group the guard has not received yet is found by [`START`], a variable that is set for it (on Linux).
//!
//! Programs that a scene started without waiting for them ([`Process::detach`]) keep running when the run ends by
//! itself, and are ended when the run is ended.
//!
//! Systems other than Unix have no process groups here. On these, only dropping a [`Process`] ends its child.
//!
//! ```
//! use granita_base::Supervisor;
//! let supervisor = Supervisor::default();
//! let activity = supervisor.begin("reading scene.pyg");
//! assert_eq!(supervisor.running(), ["reading scene.pyg"]);
//! drop(activity);
//! assert!(supervisor.running().is_empty());
//! ```

use parking_lot::{Mutex, MutexGuard};
use std::collections::BTreeMap;
use std::io;
use std::process::{Child, ChildStdin, ChildStdout, Command, ExitStatus};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The environment variable of child processes by which the guard finds processes that were being started when this
/// process was killed.
pub const START: &str = "GRANITA_START";

/// Stores the activities and the child processes of a run. Clones share them.
#[derive(Clone, Default)]
pub struct Supervisor(Arc<Inner>);

#[derive(Default)]
struct Inner {
    state: Mutex<State>,
    ended: AtomicBool,
    unguarded: bool,
}

#[derive(Default)]
struct State {
    next: u64,
    activities: BTreeMap<u64, String>,
    groups: BTreeMap<u64, Group>,
    #[cfg(unix)]
    guard: Option<unix::Guard>,
}

/// A process group.
#[derive(Clone, Copy)]
struct Group {
    leader: u32,
    /// True when the leader has ended and was waited for, while other members still run.
    leaderless: bool,
}

impl std::fmt::Debug for Supervisor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("Supervisor").field(&self.running()).finish()
    }
}

impl Supervisor {
    /// Returns a supervisor for children that detect the end of this process by themselves and need no guard.
    pub fn unguarded() -> Self {
        let mut inner = Inner::default();
        inner.unguarded = true;
        Self(Arc::new(inner))
    }

    /// Records that the run does `what` until the result is dropped.
    pub fn begin(&self, what: impl Into<String>) -> Activity {
        let mut state = self.state();
        state.next += 1;
        let id = state.next;
        state.activities.insert(id, what.into());
        Activity { supervisor: self.clone(), id }
    }

    /// Returns the current activities of the run, the latest last.
    pub fn running(&self) -> Vec<String> {
        self.state().activities.values().cloned().collect()
    }

    /// Starts a child process in its own group.
    ///
    /// # Errors
    /// Returns an error when it cannot be started, or when the run is being ended ([`io::ErrorKind::Interrupted`]).
    pub fn spawn(&self, command: &mut Command, what: impl Into<String>) -> io::Result<Process> {
        let refused = || io::Error::new(io::ErrorKind::Interrupted, "the run is being ended");
        if self.has_ended() {
            return Err(refused());
        }
        #[cfg(unix)]
        {
            std::os::unix::process::CommandExt::process_group(command, 0);
            self.start_guard();
        }
        let activity = self.begin(what);
        let id = activity.id;
        let start = format!("{}.{id}", std::process::id());
        command.env(START, &start);
        self.state().tell_guard(&format!("s {start}"));
        let child = command.spawn().inspect_err(|_| self.state().tell_guard(&format!("x {start}")))?;
        let mut state = self.state();
        let group = Group { leader: child.id(), leaderless: false };
        state.groups.insert(id, group);
        state.tell_guard(&format!("+ {} {start}", group.leader));
        drop(state);
        let process = Process { child, activity: Some(activity), id, supervisor: self.clone() };
        // A child that was started while the others were ended is ended when it is dropped here.
        if self.has_ended() { Err(refused()) } else { Ok(process) }
    }

    /// Ends all child processes and the processes that they started, and prevents new ones. It first sends a signal
    /// that allows cleaning up, and after a third of a second one that does not.
    pub fn end(&self) {
        self.0.ended.store(true, Ordering::SeqCst);
        #[cfg(unix)]
        unix::end(|| self.state().groups.values().copied().collect());
    }

    /// Prevents new child processes, as [`Supervisor::end`] does, and lets those run that were started. It is for a run
    /// that is being ended and completes something first.
    pub fn close(&self) {
        self.0.ended.store(true, Ordering::SeqCst);
    }

    /// True when [`Supervisor::end`] or [`Supervisor::close`] was called.
    pub fn has_ended(&self) -> bool {
        self.0.ended.load(Ordering::SeqCst)
    }

    /// Releases detached programs, which keep running. It is called when a run ends by itself, and happens
    /// automatically when the last clone is dropped.
    pub fn release(&self) {
        self.state().release();
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.state.lock()
    }

    #[cfg(unix)]
    fn start_guard(&self) {
        let mut state = self.state();
        if state.guard.is_none() && !self.0.unguarded {
            // Without a guard, child processes remain only when this process is killed.
            state.guard = unix::Guard::start().ok();
        }
    }

    /// Records that the leader of a group was waited for. Returns the group when it still has members.
    fn leader_ended(&self, id: u64) {
        let mut state = self.state();
        let Some(group) = state.groups.get(&id).copied() else { return };
        let left = Group { leaderless: true, ..group };
        #[cfg(unix)]
        if unix::has_members(left) {
            state.groups.insert(id, left);
            state.tell_guard(&format!("l {}", left.leader));
            return;
        }
        state.groups.remove(&id);
        state.tell_guard(&format!("- {}", left.leader));
    }

    fn end_group(&self, id: u64) {
        let mut state = self.state();
        let Some(group) = state.groups.remove(&id) else { return };
        #[cfg(unix)]
        unix::kill(group);
        state.tell_guard(&format!("- {}", group.leader));
    }
}

impl Drop for Inner {
    fn drop(&mut self) {
        self.state.get_mut().release();
    }
}

impl State {
    fn release(&mut self) {
        self.groups.clear();
        #[cfg(unix)]
        if let Some(guard) = self.guard.take() {
            guard.dismiss();
        }
    }

    #[cfg(unix)]
    fn tell_guard(&self, line: &str) {
        if let Some(guard) = &self.guard {
            guard.tell(line);
        }
    }

    #[cfg(not(unix))]
    #[expect(clippy::unused_self, reason = "there are no guards here")]
    fn tell_guard(&self, _: &str) {}
}

/// An activity of a run, until this is dropped.
#[derive(Debug)]
pub struct Activity {
    supervisor: Supervisor,
    id: u64,
}

impl Drop for Activity {
    fn drop(&mut self) {
        self.supervisor.state().activities.remove(&self.id);
    }
}

/// A child process. When it is dropped, the child and everything that it started are ended at once.
#[derive(Debug)]
pub struct Process {
    child: Child,
    activity: Option<Activity>,
    id: u64,
    supervisor: Supervisor,
}

impl Process {
    /// Returns its standard input once, if that is a pipe.
    pub fn take_stdin(&mut self) -> Option<ChildStdin> {
        self.child.stdin.take()
    }

    /// Returns its standard output once, if that is a pipe.
    pub fn take_stdout(&mut self) -> Option<ChildStdout> {
        self.child.stdout.take()
    }

    /// Waits until the child has ended. Programs that it started in the background keep running.
    ///
    /// # Errors
    /// Returns the system's error.
    pub fn wait(&mut self) -> io::Result<ExitStatus> {
        let status = self.child.wait();
        self.activity = None;
        self.supervisor.leader_ended(self.id);
        status
    }

    /// Does the same as [`Process::wait`] for a process that has closed its output and is about to end. A process
    /// that does not end within `most` is ended.
    ///
    /// # Errors
    /// Returns the system's error.
    pub fn wait_for_end(&mut self, most: Duration) -> io::Result<ExitStatus> {
        let begin = Instant::now();
        self.wait_while(|| begin.elapsed() < most)
    }

    /// Does the same as [`Process::wait`] as long as `goes_on` is true. A process that has not ended then is ended.
    ///
    /// # Errors
    /// Returns the system's error.
    pub fn wait_while(&mut self, mut goes_on: impl FnMut() -> bool) -> io::Result<ExitStatus> {
        while goes_on() && self.child.try_wait()?.is_none() {
            std::thread::sleep(Duration::from_millis(2));
        }
        if self.child.try_wait()?.is_none() {
            self.supervisor.end_group(self.id);
            self.child.kill()?;
        }
        self.wait()
    }

    /// Lets the child continue without being waited for.
    pub fn detach(mut self) {
        self.activity = None;
        // A thread waits for its end, because otherwise it would stay in the table of processes.
        std::thread::spawn(move || self.wait());
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        if self.activity.is_none() {
            // The child was already waited for.
            return;
        }
        self.supervisor.end_group(self.id);
        // This is for systems without groups. Both calls fail when the child has already ended.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(unix)]
mod unix {
    use super::Group;
    use rustix::net::SendFlags;
    use rustix::process::{Pid, Signal, kill_process_group, test_kill_process, test_kill_process_group};
    use std::io;
    use std::os::fd::OwnedFd;
    use std::os::unix::net::UnixStream;
    use std::os::unix::process::CommandExt;
    use std::process::{Child, Command, Stdio};
    use std::time::{Duration, Instant};

    /// The time that processes have for cleaning up.
    const GRACE: Duration = Duration::from_millis(300);

    /// A script that receives the list of groups from the process at the other end, and ends them when that process
    /// is gone. It must outlive the signals that end a whole terminal. A group without its leader is not signalled
    /// when its number belongs to another process.
    ///
    /// A child holds the connection until it runs its program, and then has its variables. Processes that are being
    /// started are therefore all found. The whole group of each is ended (the third word after the name in its
    /// status), because it may start others while the guard looks.
    const GUARD: &str = r#"trap '' HUP INT TERM QUIT TSTP
cd /
groups=
starts=
without() {
    left=
    for g in $groups; do [ "${g#l}" = "$1" ] || left="$left $g"; done
    groups=$left
}
send() {
    for g in $groups; do
        case $g in
            l*) kill -s 0 "${g#l}" || kill -s "$1" -- "-${g#l}" ;;
            *) kill -s "$1" -- "-$g" ;;
        esac && some=1
    done
}
started() {
    left=
    for s in $starts; do [ "$s" = "$1" ] || left="$left $s"; done
    starts=$left
}
while read -r word number start; do
    case $word in
        s) starts="$starts $number" ;;
        x) started "$number" ;;
        +) groups="$groups $number"; started "$start" ;;
        -) without "$number" ;;
        l) without "$number"; groups="$groups l$number" ;;
        q) exit ;;
    esac
done
for s in $starts; do
    for e in /proc/[0-9]*/environ; do
        tr '\0' '\n' < "$e" | grep -qx "GRANITA_START=$s" && read -r stat < "${e%environ}stat" || continue
        set -- ${stat##*) }
        kill -s KILL -- "-$3"
    done
done
some=
send TERM
[ -z "$some" ] && exit
sleep 1
send KILL
"#;

    fn pid(group: Group) -> Option<Pid> {
        Pid::from_raw(i32::try_from(group.leader).ok()?)
    }

    /// True when a signal may be sent. A group without its leader is gone when its number belongs to another process.
    pub(super) fn has_members(group: Group) -> bool {
        let reused = |pid| group.leaderless && test_kill_process(pid) != Err(rustix::io::Errno::SRCH);
        pid(group).is_some_and(|pid| !reused(pid) && test_kill_process_group(pid).is_ok())
    }

    fn signal(group: Group, signal: Signal) {
        if has_members(group)
            && let Some(pid) = pid(group)
        {
            // The group may have ended meanwhile.
            let _ = kill_process_group(pid, signal);
        }
    }

    pub(super) fn kill(group: Group) {
        signal(group, Signal::KILL);
    }

    /// Ends the groups of a list that becomes shorter meanwhile.
    pub(super) fn end(groups: impl Fn() -> Vec<Group>) {
        let begin = Instant::now();
        groups().into_iter().for_each(|group| signal(group, Signal::TERM));
        while begin.elapsed() < GRACE && groups().into_iter().any(has_members) {
            std::thread::sleep(Duration::from_millis(5));
        }
        groups().into_iter().for_each(kill);
    }

    /// The process that ends the groups when this one is killed.
    pub(super) struct Guard {
        child: Child,
        to: UnixStream,
    }

    impl Guard {
        pub(super) fn start() -> io::Result<Self> {
            // This is a socket, because writing to a socket with a closed other end raises no signal, unlike a pipe.
            let (to, from) = UnixStream::pair()?;
            let child = Command::new("/bin/sh")
                .args(["-c", GUARD])
                .stdin(Stdio::from(OwnedFd::from(from)))
                .stdout(Stdio::null())
                .stderr(Stdio::null())
                .process_group(0)
                .spawn()?;
            Ok(Self { child, to })
        }

        pub(super) fn tell(&self, line: &str) {
            let line = format!("{line}\n");
            // Without a guard, child processes remain only when this process is killed.
            let _ = rustix::net::send(&self.to, line.as_bytes(), SendFlags::NOSIGNAL | SendFlags::DONTWAIT);
        }

        pub(super) fn dismiss(mut self) {
            self.tell("q");
            drop(self.to);
            let _ = self.child.wait();
        }
    }
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;
    use std::io::{BufRead, BufReader};
    #[cfg(target_os = "linux")]
    use std::os::unix::process::CommandExt;
    use std::process::Stdio;

    fn alive(pid: &str) -> bool {
        // A process that has ended but was not waited for has state Z.
        let state = Command::new("ps").args(["-o", "stat=", "-p", pid]).output().unwrap();
        let state = String::from_utf8(state.stdout).unwrap();
        !state.trim().is_empty() && !state.trim_start().starts_with('Z')
    }

    fn ends(pid: &str) -> bool {
        let begin = Instant::now();
        while alive(pid) && begin.elapsed() < Duration::from_secs(5) {
            std::thread::sleep(Duration::from_millis(5));
        }
        !alive(pid)
    }

    /// Starts a shell with a child process, whose number it prints.
    fn shell(supervisor: &Supervisor, tail: &str) -> (Process, String) {
        let line = format!("sleep 1000 & echo $!; {tail}");
        let mut command = Command::new("sh");
        command.args(["-c", &line]).stdout(Stdio::piped());
        let mut process = supervisor.spawn(&mut command, "running a shell").unwrap();
        let mut number = String::new();
        BufReader::new(process.take_stdout().unwrap()).read_line(&mut number).unwrap();
        (process, number.trim().to_owned())
    }

    #[test]
    fn a_process_that_only_closed_its_output_is_not_waited_for() {
        let supervisor = Supervisor::default();
        let mut command = Command::new("sh");
        command.args(["-c", "exec sleep 1000"]);
        let mut process = supervisor.spawn(&mut command, "").unwrap();
        let begin = Instant::now();
        assert!(!process.wait_for_end(Duration::from_millis(20)).unwrap().success());
        assert!(begin.elapsed() < Duration::from_secs(5));
        let mut process = supervisor.spawn(&mut Command::new("true"), "").unwrap();
        assert!(process.wait_for_end(Duration::from_secs(5)).unwrap().success());
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn the_guard_ends_a_child_that_was_being_started() {
        let start = format!("{}.guard-test", std::process::id());
        let began = |guard: &unix::Guard| {
            guard.tell(&format!("s {start}"));
            Command::new("sleep").arg("1000").env(START, &start).process_group(0).spawn().unwrap()
        };
        let guard = unix::Guard::start().unwrap();
        let mut child = began(&guard);
        drop(guard);
        assert!(ends(&child.id().to_string()));
        child.wait().unwrap();
        // A child whose start failed, or whose group is known and was given up, is not searched for.
        let guard = unix::Guard::start().unwrap();
        let mut child = began(&guard);
        guard.tell(&format!("x {start}"));
        drop(guard);
        std::thread::sleep(Duration::from_millis(300));
        assert!(alive(&child.id().to_string()));
        child.kill().unwrap();
        child.wait().unwrap();
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn the_guard_ends_what_a_child_starts_while_it_is_searched_for() {
        let start = format!("{}.forking-test", std::process::id());
        let guard = unix::Guard::start().unwrap();
        guard.tell(&format!("s {start}"));
        let forks = "for i in $(seq 3000); do sleep 1000 > /dev/null & echo $!; sleep 0.01; done; wait";
        let mut command = Command::new("sh");
        command.args(["-c", forks]).env(START, &start).process_group(0).stdout(Stdio::piped());
        let mut child = command.spawn().unwrap();
        drop(guard);
        let lines = BufReader::new(child.stdout.take().unwrap()).lines();
        let numbers: Vec<String> = lines.map(Result::unwrap).collect();
        child.wait().unwrap();
        std::thread::sleep(Duration::from_millis(500));
        let left = numbers.iter().filter(|pid| alive(pid)).count();
        let _ = Command::new("kill").args(["-s", "KILL", "--"]).args(&numbers).output();
        assert!(numbers.len() < 3000 && left == 0, "{left} of {}", numbers.len());
    }

    #[test]
    fn dropping_a_process_ends_its_process_group() {
        let supervisor = Supervisor::default();
        let (process, grandchild) = shell(&supervisor, "wait");
        assert!(alive(&grandchild));
        assert_eq!(supervisor.running(), ["running a shell"]);
        drop(process);
        assert!(supervisor.running().is_empty());
        assert!(ends(&grandchild));
    }

    #[test]
    fn background_programs_end_when_the_run_is_ended() {
        let supervisor = Supervisor::default();
        let (mut process, grandchild) = shell(&supervisor, "exit 0");
        assert!(process.wait().unwrap().success());
        drop(process);
        assert!(alive(&grandchild), "it was started to go on");
        let (stubborn, child) = shell(&supervisor, "trap '' TERM; while :; do sleep 1000; done");
        let begin = Instant::now();
        supervisor.end();
        assert!(begin.elapsed() < Duration::from_secs(2));
        assert!(ends(&grandchild) && ends(&child));
        drop(stubborn);
        let error = supervisor.spawn(&mut Command::new("true"), "").unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::Interrupted);
    }

    #[test]
    fn the_guard_ends_the_programs_that_remain() {
        let supervisor = Supervisor::default();
        let (process, grandchild) = shell(&supervisor, "wait");
        let (other, kept) = shell(&supervisor, "exit 0");
        other.detach();
        // This simulates the death of this process. Its end of the connection closes, and nothing else happens.
        let guard = supervisor.state().guard.take();
        drop(guard);
        assert!(ends(&grandchild) && ends(&kept));
        drop(process);
    }

    #[test]
    fn programs_continue_after_a_run_that_ends_by_itself() {
        let supervisor = Supervisor::default();
        let (other, kept) = shell(&supervisor, "exit 0");
        other.detach();
        supervisor.release();
        std::thread::sleep(Duration::from_millis(50));
        assert!(alive(&kept));
        let ended = Command::new("kill").args(["-9", &kept]).status().unwrap();
        assert!(ended.success());
    }
}
