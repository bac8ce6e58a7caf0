//! A second thread for updates, which comes at once while it is needed often.
//!
//! To wake a thread that sleeps takes as long as half an update. So the helper stays awake for a while where the next
//! work for it is likely: after a call, and from the moment when it is told that there is room for it.

use crate::error::{Error, Result};
use rayon::{Scope, ThreadPool, ThreadPoolBuilder};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// How long the helper waits for work before it sleeps: longer than a step of some hundred robots.
const LINGERS: Duration = Duration::from_millis(1);

/// A thread, and whether there is a processor for it.
#[derive(Debug)]
pub struct Helper {
    pool: ThreadPool,
    /// Whether there is room for it, which any thread may say.
    room: AtomicBool,
    /// Whether it is to wait for work awake.
    lingers: Arc<AtomicBool>,
    /// Whose thread it is: a fork takes only the calling one along.
    process: u32,
}

impl Helper {
    /// Starts the thread, for which there is room at first.
    ///
    /// # Errors
    /// A thread that does not start.
    pub fn new() -> Result<Self> {
        let pool = ThreadPoolBuilder::new().num_threads(1).thread_name(|_| "navlearn".into()).build();
        let pool = pool.map_err(|e| Error::Thread { reason: e.to_string() })?;
        Ok(Self { pool, room: AtomicBool::new(true), lingers: Arc::default(), process: std::process::id() })
    }

    /// Whether the thread exists: not after a fork.
    pub fn exists(&self) -> bool {
        self.process == std::process::id()
    }

    /// Whether there is room for the thread.
    pub fn has_room(&self) -> bool {
        self.room.load(Ordering::Relaxed)
    }

    /// Tells from any thread whether there is room for the helper, also while updates are made.
    pub fn set_room(&self, room: bool) {
        self.room.store(room, Ordering::Relaxed);
        if room { self.linger() } else { self.lingers.store(false, Ordering::Relaxed) }
    }

    /// Calls `lead` with what starts work on the helper, and returns when both have ended.
    pub fn beside<'a, R>(&self, lead: impl FnOnce(&Start<'_, 'a>) -> R) -> R {
        let result = self.pool.in_place_scope(|scope| lead(&Start { scope, lingers: &self.lingers }));
        if self.has_room() {
            self.linger();
        }
        result
    }

    /// Keeps the thread awake for a while, unless it is already.
    fn linger(&self) {
        if !self.exists() || self.lingers.swap(true, Ordering::Relaxed) {
            return;
        }
        let lingers = Arc::clone(&self.lingers);
        self.pool.spawn(move || {
            let start = Instant::now();
            while lingers.load(Ordering::Relaxed) && start.elapsed() < LINGERS {
                std::hint::spin_loop();
            }
            lingers.store(false, Ordering::Relaxed);
        });
    }
}

/// Starts work on the helper.
pub struct Start<'s, 'a> {
    scope: &'s Scope<'a>,
    lingers: &'s AtomicBool,
}

impl<'a> Start<'_, 'a> {
    /// Lets the helper do `work` as soon as it can.
    pub fn work(&self, work: impl FnOnce() + Send + 'a) {
        self.scope.spawn(|_| work());
        // Only now, so that it finds the work when it looks for some.
        self.lingers.store(false, Ordering::Relaxed);
    }
}
