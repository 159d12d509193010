//! The window alone, without the command around it: `cargo run -p palpate-viewer --example window -- pad`.

use palpate_viewer::command::{Request, open};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let body = std::env::args().nth(1).map(Into::into);
    open(&Request { body, ..Request::default() }, Box::new(|_| false))?;
    Ok(())
}
