//! The window on a display.

use crate::renderer;
use crate::state::{Event, Viewer};
use crate::ui;
use eframe::egui;
use eframe::wgpu;
use palpate::runtime::Outcome;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

/// How often a picture is drawn while something moves.
const PERIOD: Duration = Duration::from_millis(16);
/// And while nothing does: what is under way may end.
const IDLE: Duration = Duration::from_millis(200);

/// Whether the end was asked for from outside, as by a signal. It sees each picture's viewer before it is drawn, and is asked now
/// and then while the window is hidden.
pub type Ends = Box<dyn FnMut(&Viewer) -> bool>;

struct App {
    viewer: Viewer,
    ends: Ends,
    began: Instant,
    /// What a watched session came to, once the window is closed.
    outcome: Arc<Mutex<Option<Outcome>>>,
}

impl eframe::App for App {
    /// Also while the window is hidden, and draws nothing.
    fn logic(&mut self, context: &egui::Context, _frame: &mut eframe::Frame) {
        self.viewer.tick(self.began.elapsed().as_secs_f64());
        if (self.ends)(&self.viewer) {
            context.send_viewport_cmd(egui::ViewportCommand::Close);
        }
        context.request_repaint_after(IDLE);
    }

    fn ui(&mut self, ui: &mut egui::Ui, _frame: &mut eframe::Frame) {
        let events = ui::show(&self.viewer, ui);
        self.viewer.update(events);
        if self.viewer.is_moving() {
            ui.ctx().request_repaint_after(PERIOD);
        }
    }

    fn on_exit(&mut self) {
        *self.outcome.lock().unwrap_or_else(PoisonError::into_inner) = self.viewer.end();
    }
}

/// Whether there is a display to open a window on.
pub fn has_display() -> bool {
    let is_set = |name| std::env::var_os(name).is_some_and(|v| !v.is_empty());
    !cfg!(all(unix, not(target_os = "macos"))) || is_set("DISPLAY") || is_set("WAYLAND_DISPLAY")
}

/// Asks for a display before anything else begins.
///
/// # Errors
/// There is none.
pub fn display() -> Result<(), String> {
    if has_display() {
        return Ok(());
    }
    Err("there is no display: neither DISPLAY nor WAYLAND_DISPLAY is set; open the window from a desktop, or draw a picture with \
         `palpate view --screenshot FILE`, which needs none"
        .into())
}

/// Opens a window on this viewer, and waits until it is closed or `ends` comes true. What a watched session came to, if one was.
///
/// # Errors
/// There is no display, or nothing to draw with.
pub fn open(viewer: Viewer, first: Vec<Event>, ends: Ends) -> Result<Option<Outcome>, String> {
    display()?;
    let outcome = Arc::new(Mutex::new(None));
    let theirs = outcome.clone();
    let mut viewer = viewer;
    viewer.update(first);
    if let Some(session) = viewer.to_watch() {
        // The toolkit's threads and the graphics driver's inherit it. Where it is refused they are where they would be without.
        let _ = session.keep_off_its_core();
    }
    let options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("palpate")
            .with_inner_size([1360.0, 860.0])
            .with_min_inner_size([720.0, 480.0])
            .with_drag_and_drop(true),
        renderer: eframe::Renderer::Wgpu,
        ..Default::default()
    };
    let opened = eframe::run_native(
        "palpate",
        options,
        Box::new(move |context| {
            ui::set_up(&context.egui_ctx);
            let state = context.wgpu_render_state.as_ref().ok_or("there is no graphics adapter")?;
            let is_program = state.adapter.get_info().device_type == wgpu::DeviceType::Cpu;
            // A program in place of a card has no time for four samples a pixel.
            renderer::install(state, if is_program { 1 } else { 4 });
            Ok(Box::new(App { viewer, ends, began: Instant::now(), outcome: theirs }))
        }),
    );
    opened.map_err(|e| {
        format!(
            "no window can be opened ({e}); it needs a display (X11 or Wayland) and a graphics driver, of which mesa-vulkan-drivers \
             has one that needs no card; `palpate view --screenshot FILE` needs no display"
        )
    })?;
    Ok(outcome.lock().unwrap_or_else(PoisonError::into_inner).take())
}
