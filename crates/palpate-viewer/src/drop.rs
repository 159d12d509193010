//! Files that are dropped on the window or named on the command line, and what is asked of a mesh.

use crate::work::stem_of;
use glam::DVec3;
use palpate::body::import::{self, LengthUnit};
use std::fs;
use std::path::{Path, PathBuf};

/// What a file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A body.
    Body,
    /// A recording.
    Recording,
    /// A surface mesh, of which a body can be made.
    Mesh,
    /// A spec.
    Spec,
}

/// Extensions of surface meshes.
pub const MESHES: [&str; 7] = ["obj", "stl", "ply", "off", "vtk", "vtp", "vtu"];

/// What a file is, by its first bytes and its extension.
///
/// # Errors
/// It can't be read; it is nothing that can be shown. The message says what can.
pub fn kind_of(path: &Path) -> Result<Kind, String> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default();
    let is_recording = palpate::runtime::is_recording(path).map_err(|e| palpate::files::message(&e))?;
    match extension.as_str() {
        _ if is_recording => Ok(Kind::Recording),
        "body" | "safetensors" => Ok(Kind::Body),
        "toml" => Ok(Kind::Spec),
        e if MESHES.contains(&e) => Ok(Kind::Mesh),
        _ if begins_like_a_body(path) => Ok(Kind::Body),
        _ => Err(format!(
            "{}: it is no body, recording, spec or surface mesh; drop a .body file, a recording, a .toml spec, or a mesh ({})",
            path.display(),
            MESHES.join(", ")
        )),
    }
}

/// Bodies are safetensors: eight bytes of a length, then JSON.
fn begins_like_a_body(path: &Path) -> bool {
    use std::io::Read;
    let mut first = [0; 9];
    fs::File::open(path).and_then(|mut f| f.read_exact(&mut first)).is_ok() && first[8] == b'{'
}

/// Tissue to begin with; docs/materials.md has where the numbers are from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Tissue {
    /// Liver: 5 kPa.
    Liver,
    /// The kidney's cortex: 4.2 kPa.
    Kidney,
    /// A soft silicone: EcoFlex 00-10 with as much thinner.
    SoftSilicone,
    /// A firm silicone: EcoFlex 00-50.
    FirmSilicone,
}

impl Tissue {
    /// All.
    pub const ALL: [Tissue; 4] = [Tissue::Liver, Tissue::Kidney, Tissue::SoftSilicone, Tissue::FirmSilicone];

    /// As a menu names it.
    pub fn title(self) -> &'static str {
        match self {
            Tissue::Liver => "liver, 5 kPa",
            Tissue::Kidney => "kidney, 4.2 kPa",
            Tissue::SoftSilicone => "soft silicone (EcoFlex 00-10, thinned)",
            Tissue::FirmSilicone => "firm silicone (EcoFlex 00-50)",
        }
    }

    fn lines(self) -> &'static str {
        match self {
            Tissue::Liver => "model = \"neo-hookean\"\nyoung_modulus_pa = 5000\npoisson_ratio = 0.47\n",
            Tissue::Kidney => "model = \"neo-hookean\"\nyoung_modulus_pa = 4200\npoisson_ratio = 0.47\n",
            Tissue::SoftSilicone => {
                "model = \"yeoh\"\nc_pa = [882.238, 57.1305, 36.4231]\npoisson_ratio = 0.49\n"
            }
            Tissue::FirmSilicone => {
                "model = \"yeoh\"\nc_pa = [23332.6, -494.129, 491.781]\npoisson_ratio = 0.49\n"
            }
        }
    }
}

/// The side by which a body is held.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Held {
    /// The lowest tenth.
    Below,
    /// The tenth farthest back, along y.
    Behind,
    /// The left tenth, along x.
    Left,
}

impl Held {
    /// All.
    pub const ALL: [Held; 3] = [Held::Below, Held::Behind, Held::Left];

    /// As a menu names it.
    pub fn title(self) -> &'static str {
        match self {
            Held::Below => "its lowest tenth (−z)",
            Held::Behind => "the tenth farthest back (+y)",
            Held::Left => "its left tenth (−x)",
        }
    }

    fn outward(self) -> DVec3 {
        match self {
            Held::Below => DVec3::NEG_Z,
            Held::Behind => DVec3::Y,
            Held::Left => DVec3::NEG_X,
        }
    }
}

/// What a mesh doesn't say.
#[derive(Debug, Clone, PartialEq)]
pub struct MeshQuestion {
    /// The mesh.
    pub path: PathBuf,
    /// Of its coordinates: asked, never guessed.
    pub unit: Option<LengthUnit>,
    /// Of what it is made.
    pub tissue: Tissue,
    /// What holds it.
    pub held: Held,
    /// Radius of the ball that presses, mm.
    pub tool_radius_mm: f64,
    /// Places that are pressed.
    pub test_points: u32,
}

impl MeshQuestion {
    /// About this mesh.
    pub fn new(path: PathBuf) -> Self {
        let (tissue, held) = (Tissue::Liver, Held::Below);
        MeshQuestion { path, unit: None, tissue, held, tool_radius_mm: 5.0, test_points: 30 }
    }

    /// How large it is in the chosen unit, m.
    ///
    /// # Errors
    /// No unit yet; the mesh can't be read.
    pub fn bounds(&self) -> Result<[DVec3; 2], String> {
        let unit = self.unit.ok_or("choose the unit of the mesh's coordinates first")?;
        let mesh = import::read(&self.path, Some(unit)).map_err(|e| e.to_string())?;
        let ends = mesh
            .positions
            .iter()
            .fold([DVec3::INFINITY, DVec3::NEG_INFINITY], |[low, high], p| [low.min(*p), high.max(*p)]);
        Ok(ends)
    }

    /// Writes the spec into a folder beside the mesh, where what is simulated is kept too. Gives (spec, folder).
    ///
    /// # Errors
    /// What [`MeshQuestion::bounds`] refuses; a body too small or large for hands; the folder can't be written.
    pub fn write_spec(&self) -> Result<[PathBuf; 2], String> {
        let [low, high] = self.bounds()?;
        let size = high - low;
        let unit = match self.unit {
            Some(LengthUnit::Metre) => "m",
            Some(LengthUnit::Centimetre) => "cm",
            _ => "mm",
        };
        if !(5e-3..=2.0).contains(&size.max_element()) {
            return Err(format!(
                "{}: it is {:.4} m large in {unit}; choose another unit",
                self.path.display(),
                size.max_element()
            ));
        }
        let absolute = std::path::absolute(&self.path).unwrap_or_else(|_| self.path.clone());
        let stem = stem_of(&self.path);
        let text = self.spec(&absolute, unit, [low, high]);
        // Beside what other answers, or another mesh of this name, made before.
        for number in 1..1000 {
            let name =
                if number == 1 { format!("{stem}-palpate") } else { format!("{stem}-palpate-{number}") };
            let folder = absolute.with_file_name(name);
            let spec = folder.join(format!("{stem}.toml"));
            let unwritable = |e: std::io::Error| {
                format!("{}: can't be written ({e}); copy the mesh to a folder of your own", folder.display())
            };
            match fs::read_to_string(&spec) {
                Ok(before) if before == text => return Ok([spec, folder]),
                Err(e) if e.kind() == std::io::ErrorKind::NotFound => {
                    fs::create_dir_all(&folder).map_err(unwritable)?;
                    fs::write(&spec, text).map_err(unwritable)?;
                    return Ok([spec, folder]);
                }
                _ => {}
            }
        }
        Err(format!("{}: too many simulations of it are beside it; remove some", self.path.display()))
    }

    fn spec(&self, mesh: &Path, unit: &str, [low, high]: [DVec3; 2]) -> String {
        let size = high - low;
        let outward = self.held.outward();
        // A plane a tenth of the way in from the held side.
        let point = (low + high) * 0.5 + outward * (0.4 * size.dot(outward.abs()));
        let mm = |v: DVec3| format!("[{:.3}, {:.3}, {:.3}]", v.x * 1e3, v.y * 1e3, v.z * 1e3);
        let least = size.min_element() * 1e3;
        let depth = (0.2 * least).clamp(1.0, 8.0);
        let mesh = mesh.display().to_string().replace('\\', "\\\\").replace('"', "\\\"");
        format!(
            "# Made in the viewer from a mesh; docs/spec.md explains every key.\n\n\
             [body]\nmesh = \"{mesh}\"\nunit = \"{unit}\"\n\n\
             [[body.fixed]]\nhalf_space = {{ point_mm = {}, normal = {} }}\n\n\
             [material]\n{}\n\
             [tool]\nshape = \"sphere\"\nradius_mm = {}\n\n\
             [friction]\ncoefficient = 0.3\n\n\
             [deflection]\nnormal_max_mm = {depth:.2}\nlateral_max_mm = {:.2}\nsteps = 4\n\n\
             [test_points]\ncount = {}\n\n\
             [mesh]\nelement_size_mm = {:.2}\n",
            mm(point),
            mm(outward * 1e-3),
            self.tissue.lines(),
            self.tool_radius_mm,
            0.5 * depth,
            self.test_points,
            (0.25 * least).clamp(1.0, 20.0),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TETRAHEDRON: &str = "v 0 0 0\nv 40 0 0\nv 0 40 0\nv 0 0 40\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n";

    #[test]
    fn a_mesh_is_asked_for_its_unit_and_makes_a_spec_that_can_be_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a b.obj");
        fs::write(&path, TETRAHEDRON).unwrap();
        assert_eq!(kind_of(&path), Ok(Kind::Mesh));
        let mut question = MeshQuestion::new(path.clone());
        assert!(question.write_spec().unwrap_err().contains("unit"));
        question.unit = Some(LengthUnit::Metre);
        assert!(question.write_spec().unwrap_err().contains("another unit"));
        question.unit = Some(LengthUnit::Millimetre);
        for (tissue, held) in
            Tissue::ALL.into_iter().zip([Held::Below, Held::Behind, Held::Left, Held::Below])
        {
            (question.tissue, question.held) = (tissue, held);
            let [spec, kept] = question.write_spec().unwrap();
            assert!(spec.starts_with(&kept));
            let read = palpate::build::spec::Spec::read(&spec).unwrap();
            let simulation = read.simulation(&spec).unwrap();
            assert_eq!(simulation.fixed.len(), 1);
        }
    }

    #[test]
    fn what_can_t_be_shown_is_refused_with_what_can() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        assert!(kind_of(&path).unwrap_err().contains("a.txt"));
        fs::write(&path, "hello").unwrap();
        let error = kind_of(&path).unwrap_err();
        assert!(error.contains("drop a .body file"), "{error}");
        fs::write(&path, "PALPATE?").unwrap();
        assert!(kind_of(&path).is_err());
    }
}
