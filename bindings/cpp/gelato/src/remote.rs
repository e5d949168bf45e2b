//! The renderer that works while its program goes on (reference 2.3): a session in a thread of its own, which gets calls
//! through a queue.

use crate::live::{During, Host, session};
use crate::object;
use granita_base::{Location, Param, Reporter, Severity};
use granita_plugin::{InterfaceObject, Meanwhile, Messages};
use granita_scene::{Call, SceneSink, Stop};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};
use std::thread::JoinHandle;

/// So many calls wait at most; who makes more waits himself.
const QUEUE: usize = 4096;

/// What goes through the queue.
enum Word {
    Call(Box<Call>, Location),
    Ask(String, Sender<Option<Param>>),
    /// Answered when everything before is done.
    Wait(Sender<()>),
}

struct Remote {
    queue: Option<SyncSender<Word>>,
    during: Arc<During>,
    /// A frame is on its way.
    rendering: Arc<AtomicBool>,
    reporter: Reporter,
    thread: Option<JoinHandle<()>>,
}

/// A renderer in a thread of its own.
pub(crate) fn renderer(manager: &Messages) -> Result<InterfaceObject<'static>, String> {
    let (queue, words) = sync_channel(QUEUE);
    let (ready, made) = channel();
    let rendering = Arc::new(AtomicBool::new(false));
    let (flag, reporter) = (rendering.clone(), manager.reporter().clone());
    let thread = std::thread::Builder::new()
        .name("gelato".to_owned())
        .spawn(move || {
            let (session, during) = session(&reporter);
            let during = Arc::new(during);
            if ready.send((during, session.plugins().clone())).is_ok() {
                work(session, &words, &flag);
            }
        })
        .map_err(|e| e.to_string())?;
    let (during, plugins) = made.recv().map_err(|_| "the renderer did not start".to_owned())?;
    let remote = Remote {
        queue: Some(queue),
        during: during.clone(),
        rendering,
        reporter: manager.reporter().clone(),
        thread: Some(thread),
    };
    Ok(object(Box::new(remote), Box::new(Host(plugins)), manager, Some(during)))
}

/// Takes calls until nobody can make any more.
fn work(mut session: granita_session::Session, words: &Receiver<Word>, rendering: &AtomicBool) {
    let mut stopped = false;
    for word in words {
        match word {
            Word::Call(call, at) => {
                let renders = matches!(*call, Call::Render { .. });
                if !stopped {
                    stopped = session.state().call(*call, &at).is_err();
                }
                if renders {
                    rendering.store(false, Ordering::Release);
                }
            }
            // Whoever asked may be gone.
            Word::Ask(declaration, answer) => {
                let _ = answer.send(session.state_ref().attribute(&declaration));
            }
            Word::Wait(answer) => {
                let _ = answer.send(());
            }
        }
    }
    session.finish();
}

impl Remote {
    fn put(&self, word: Word) -> Result<(), Stop> {
        let gone = || Stop::Failed("the renderer's thread has ended".to_owned());
        self.queue.as_ref().ok_or_else(gone)?.send(word).map_err(|_| gone())
    }

    fn wait(&self) -> Result<(), Stop> {
        let (answer, done) = channel();
        self.put(Word::Wait(answer))?;
        let _ = done.recv();
        Ok(())
    }
}

impl SceneSink for Remote {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        if let Call::Command { name, .. } = &call
            && &**name == "wait"
        {
            return self.wait();
        }
        if self.rendering.load(Ordering::Acquire) {
            let taken = match &call {
                Call::Command { name, .. } => self.during.command(name),
                _ => false,
            };
            if !taken {
                let text = format!("{} is ignored while a frame is rendered", call.name());
                self.reporter.say(Severity::Error, at, text);
            }
            return Ok(());
        }
        if matches!(call, Call::Render { .. }) {
            self.rendering.store(true, Ordering::Release);
        }
        self.put(Word::Call(Box::new(call), at.clone()))
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        if self.rendering.load(Ordering::Acquire) {
            let name = declaration.split_whitespace().next_back()?;
            return self.during.attribute(name);
        }
        let (answer, value) = channel();
        self.put(Word::Ask(declaration.to_owned(), answer)).ok()?;
        value.recv().ok()?
    }
}

impl Drop for Remote {
    fn drop(&mut self) {
        self.queue = None;
        if let Some(thread) = self.thread.take() {
            // A frame that is on its way is finished; who does not want that says Command ("return") first.
            let _ = thread.join();
        }
    }
}
