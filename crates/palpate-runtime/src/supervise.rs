//! Several sessions side by side, until each has ended.

use crate::{LiveSession, Outcome};
use std::time::Duration;

/// Watches sessions; called from the thread that supervises them.
pub trait Observer {
    /// Between two looks, 5 ms if nothing else is said.
    fn pause(&self) -> Duration {
        Duration::from_millis(5)
    }

    /// After each pause, while session `index` runs.
    fn look(&mut self, _index: usize, _session: &LiveSession) {}

    /// When it has ended. The others go on.
    fn ended(&mut self, _index: usize, _outcome: &Outcome) {}
}

/// Nobody watches.
impl Observer for () {}

/// Waits until all `sessions` have ended; `stop` says whether, and why, they are to be ended before their time. One that fails
/// ends alone.
pub fn supervise(
    sessions: Vec<LiveSession>,
    stop: &dyn Fn() -> Option<&'static str>,
    observer: &mut dyn Observer,
) -> Vec<Outcome> {
    let mut running: Vec<_> = sessions.into_iter().map(Some).collect();
    let mut outcomes: Vec<Option<Outcome>> = running.iter().map(|_| None).collect();
    while running.iter().any(Option::is_some) {
        let stop = stop();
        for (index, (slot, outcome)) in running.iter_mut().zip(&mut outcomes).enumerate() {
            if let Some(session) = slot.take_if(|s| s.is_over()) {
                let ended = session.join();
                observer.ended(index, &ended);
                *outcome = Some(ended);
            }
            let Some(session) = slot else { continue };
            stop.into_iter().for_each(|why| session.stopper().stop(why));
            observer.look(index, session);
        }
        if running.iter().any(Option::is_some) {
            std::thread::sleep(observer.pause());
        }
    }
    outcomes.into_iter().flatten().collect()
}
