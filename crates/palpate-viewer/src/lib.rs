//! The window of palpate: see what is touched, and touch it with the mouse.
//!
//! ```text
//! events (mouse, keys, drops) ─→ Viewer ←─ records ── session's board, recording
//!                                  │ ─ where the hand wants to be ─→ simulated hand
//!                                  └─→ Scene ─→ Renderer ─→ picture
//! ```
//!
//! A [`Viewer`] is all that the program is without a window: it takes [`Event`]s, lets time go on, and says what is to be
//! seen. [`ui::show`] reads it and answers with events; [`Offscreen`] draws it without a display, and [`command`] has what
//! `palpate view` does. The haptic thread knows nothing of any of it: it writes its records onto a board whether somebody looks or not.
//!
//! ```
//! use palpate_viewer::{Event, StandardView, Viewer, gallery::Example};
//!
//! let mut viewer = Viewer::default();
//! viewer.touches = false; // no session
//! viewer.update([Event::Example(Example::Pad), Event::Look(StandardView::Top)]);
//! viewer.finish_work()?;
//! assert_eq!(viewer.subject().map(|s| s.name.as_str()), Some("Soft pad"));
//! # Ok::<(), String>(())
//! ```

pub mod animation;
pub mod camera;
pub mod colouring;
pub mod command;
pub mod deform;
pub mod drop;
pub mod gallery;
pub mod input;
pub mod offscreen;
pub mod palette;
pub mod panels;
pub mod place;
pub mod playback;
pub mod renderer;
pub mod scene;
pub mod settings;
pub mod shown;
pub mod solid;
pub mod sound;
pub mod speaker;
pub mod state;
pub mod still;
pub mod subject;
pub mod surface;
pub mod tool;
pub mod touch;
pub mod ui;
pub mod window;
pub mod work;

pub use camera::{Camera, CameraChoice, StandardView};
pub use colouring::Colouring;
pub use offscreen::{DrawError, Offscreen, Picture};
pub use settings::Settings;
pub use shown::Shown;
pub use state::{Event, Viewer};
