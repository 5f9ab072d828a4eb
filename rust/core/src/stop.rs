//! Long work that can be stopped from outside: whoever called is asked now and then whether to go on.

use std::cell::{Cell, RefCell};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

use rayon::prelude::*;

use crate::error::{Error, Result};

/// Time between two questions: short for a person who waits, long beside the question.
const PATIENCE: Duration = Duration::from_millis(50);

static ASKED: OnceLock<fn() -> bool> = OnceLock::new();

thread_local! {
    /// When this thread may ask next.
    static NEXT: Cell<Option<Instant>> = const { Cell::new(None) };
    /// Of a thread that works for another one: whether that one wants it to stop.
    static STOP: RefCell<Option<Arc<AtomicBool>>> = const { RefCell::new(None) };
}

/// From now on `wanted` is asked, by the thread that called into the core and some twenty times a second, whether to
/// stop; then the call ends with [`Error::Stopped`]. Only the first one is taken.
pub fn ask_before_going_on(wanted: fn() -> bool) {
    ASKED.get_or_init(|| wanted);
}

/// To be called every few thousand steps of what may take long.
///
/// # Errors
/// [`Error::Stopped`].
pub(crate) fn go_on() -> Result<()> {
    #[cfg(test)]
    tests::count();
    let stops = STOP.with_borrow(|stop| stop.as_ref().map(|stop| stop.load(Ordering::Relaxed)));
    if stops.unwrap_or_else(wanted) { Err(Error::Stopped) } else { Ok(()) }
}

/// Whether the caller of this thread wants it to stop, as far as it is time to ask.
fn wanted() -> bool {
    let Some(asked) = ASKED.get() else { return false };
    let now = Instant::now();
    if NEXT.get().is_some_and(|next| now < next) {
        return false;
    }
    NEXT.set(Some(now + PATIENCE));
    asked()
}

/// `work` on each of `items`, side by side where there are several, while this thread asks whether to go on.
///
/// # Errors
/// The first one of `work`, and [`Error::Stopped`].
pub(crate) fn each<T: Sync, R: Send>(items: &[T], work: impl Fn(usize, &T) -> Result<R> + Sync) -> Result<Vec<R>> {
    if items.len() < 2 {
        return items.iter().enumerate().map(|(k, item)| work(k, item)).collect();
    }
    let stop = STOP.with_borrow(Clone::clone).unwrap_or_default();
    let all = || {
        let run = |(k, item)| {
            let before = STOP.replace(Some(stop.clone()));
            let found = work(k, item);
            STOP.set(before);
            found
        };
        items.par_iter().enumerate().map(run).collect()
    };
    if rayon::current_thread_index().is_some() {
        return all(); // a thread of the pool has to work, and cannot wait
    }
    let (done, finished) = channel();
    rayon::in_place_scope(|scope| {
        scope.spawn(|_| done.send(all()).unwrap_or_default());
        loop {
            match finished.recv_timeout(PATIENCE) {
                Ok(found) => return found,
                Err(RecvTimeoutError::Timeout) => stop.fetch_or(wanted(), Ordering::Relaxed),
                Err(RecvTimeoutError::Disconnected) => return Err(Error::Stopped), // it panicked, which the scope shows
            };
        }
    })
}

#[cfg(test)]
mod tests;
