//! The body file: what is written is read back, and nothing else gets in.

#![allow(unsafe_code, reason = "an allocator that measures is an unsafe trait")]

#[path = "support/coupled.rs"]
mod support;

use glam::DVec3;
use palpate_body::{
    BlendWeights, Body, BodyParts, BodySource, ContactModel, CoupledLaw, Curve, Extension, Fineness,
    Interpolation, InterpolationErrors, LeftOut, PointErrors, PotentialErrors, Provenance, Response,
    SlipRule, StoredBody, Surface, Tensor, Tool, TriangleMesh, tensor,
};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::path::Path;

/// Remembers the largest block that this thread ever asked for, how much it holds, and held at most.
struct Measuring;

thread_local! {
    static LARGEST: Cell<usize> = const { Cell::new(0) };
    static HELD: Cell<isize> = const { Cell::new(0) };
    static PEAK: Cell<isize> = const { Cell::new(0) };
}

/// What `make` holds in the end and held at most, bytes.
fn memory_of<T>(make: impl FnOnce() -> T) -> (T, isize, isize) {
    let before = HELD.get();
    PEAK.set(before);
    let made = make();
    (made, HELD.get() - before, PEAK.get() - before)
}

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Measuring {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.set(LARGEST.get().max(layout.size()));
        HELD.set(HELD.get() + layout.size() as isize);
        PEAK.set(PEAK.get().max(HELD.get()));
        // SAFETY: the caller's promises are passed on.
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        HELD.set(HELD.get() - layout.size() as isize);
        // SAFETY: the caller's promises are passed on.
        unsafe { System.dealloc(at, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Measuring = Measuring;

fn cube() -> TriangleMesh {
    let positions =
        (0..8).map(|i| DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2) as f64) * 0.04).collect();
    let quads = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
    TriangleMesh { positions, triangles }
}

/// An open plane of `across` × `along` squares of 1 mm.
fn plane(across: u32, along: u32) -> TriangleMesh {
    let at = |i: u32, j: u32| i + (across + 1) * j;
    let positions =
        (0..=along).flat_map(|j| (0..=across).map(move |i| DVec3::new(i as f64, j as f64, 0.0) * 1e-3));
    let squares = (0..along).flat_map(|j| (0..across).map(move |i| (i, j)));
    let triangles = squares
        .flat_map(|(i, j)| {
            [[at(i, j), at(i + 1, j), at(i + 1, j + 1)], [at(i, j), at(i + 1, j + 1), at(i, j + 1)]]
        })
        .collect();
    TriangleMesh { positions: positions.collect(), triangles }
}

fn response(k: f64) -> Response {
    let knots = [0.0, 1e-3, 3e-3, 8e-3];
    let through =
        |values: [f64; 4], extension| Curve::through(&knots, &values, Interpolation::Pchip, extension);
    Response {
        normal: through(knots.map(|d| 100.0 * k * d * d), Extension::Linear).unwrap(),
        friction: through([0.1, 0.3, 0.2, 0.25], Extension::Constant).unwrap(),
        lateral: Curve::through(
            &[0.0, 2e-3, 5e-3],
            &[0.0, 2e-3 * k, 4e-3 * k],
            Interpolation::Linear,
            Extension::Linear,
        )
        .unwrap(),
    }
}

fn body(mesh: &TriangleMesh, crease_angle: f64, points: u32) -> Body {
    made(mesh, crease_angle, points, |_| None)
}

/// The same, stiffer laterally in one direction than in the other by a factor of 1 to 100.
fn anisotropic(mesh: &TriangleMesh, points: u32) -> Body {
    made(mesh, 0.5, points, |inward| {
        let ratio = |n: usize| if n == 0 { tensor::MAX_RATIO } else { 1.0 + n as f64 };
        let axis = |n: usize| DVec3::new(1.0, n as f64, 0.3);
        let tensor = |(n, &u)| tensor::along(axis(n), ratio(n), u).unwrap();
        Some(inward.iter().enumerate().map(tensor).collect())
    })
}

fn made(
    mesh: &TriangleMesh,
    crease_angle: f64,
    points: u32,
    tensors: impl Fn(&[DVec3]) -> Option<Vec<Tensor>>,
) -> Body {
    let surface = Surface::build(mesh, crease_angle).unwrap();
    let nodes = surface.positions().len() as u32;
    let blend = |n: u32| BlendWeights {
        test_points: [n % points, (n + 1) % points, 0],
        weights: [0.7, 0.1 + 0.2, 0.0],
    };
    Body::new(BodyParts {
        blends: (0..nodes).map(blend).collect(),
        coupled: None,
        lateral_tensors: tensors(surface.inward_normals()),
        surface,
        responses: (0..points).map(|t| response(300.0 + 70.0 * t as f64)).collect(),
        test_point_nodes: (0..points).collect(),
        tool: Tool::Sphere { radius_m: 0.01 / 3.0 },
        slip: SlipRule::Paper,
        tank: true,
        partial_slip: false,
        provenance: Provenance {
            command: "palpate fit --mesh \"a b.stl\"".into(),
            software: "palpate 0.1.0".into(),
            spec: Some("[body]\nunit = \"mm\" # ½\n".into()),
            inputs: [("a b.stl".to_string(), "00ff".to_string()), ("x.csv".to_string(), "17".to_string())]
                .into(),
            notes: vec!["nothing was repaired".into()],
            point_errors: vec![PointErrors { largest_force_n: 0.1 + 0.2, ..Default::default() }],
            potential_errors: vec![PotentialErrors { largest_force_n: 0.1 + 0.2, ..Default::default() }],
            interpolation: Some(InterpolationErrors {
                left_out: vec![LeftOut {
                    normalisation: "none".into(),
                    mean_percent: 0.7,
                    ..Default::default()
                }],
                by_count: Vec::new(),
            }),
        },
    })
    .unwrap()
}

/// The same places with a coupled law.
fn coupled(mesh: &TriangleMesh, points: u32) -> Body {
    let mut parts = body(mesh, 0.5, points).parts();
    let potential = |t: u32| {
        let u = parts.surface.inward_normals()[t as usize];
        let t1 = u.any_orthonormal_vector();
        palpate_body::Potential { tangents: [t1, u.cross(t1)], ..support::potential(u64::from(t), 0.3) }
    };
    let potentials = (0..points).map(potential).collect();
    parts.coupled = Some(CoupledLaw { range_m: support::RANGE, potentials });
    parts.responses.clear();
    Body::new(parts).unwrap()
}

fn bodies() -> [Body; 7] {
    let (cube, plane) = (cube(), plane(4, 2));
    [
        body(&cube, 0.5, 4),
        body(&cube, 0.5, 4).with_tank(false),
        body(&cube, f64::INFINITY, 1),
        body(&plane, 0.5, 15),
        anisotropic(&plane, 3),
        coupled(&plane, 15),
        coupled(&cube, 3),
    ]
}

#[test]
fn what_is_written_is_read() {
    let folder = tempfile::tempdir().unwrap();
    for (i, body) in bodies().into_iter().enumerate() {
        let bytes = body.to_bytes().unwrap();
        assert_eq!(bytes, body.clone().to_bytes().unwrap(), "the same body has the same bytes");
        assert_eq!(Body::from_bytes(&bytes).unwrap(), body);

        let path = folder.path().join(format!("{i}.body"));
        body.save(&path).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), bytes);
        let read = Body::open(&path).unwrap();
        assert_eq!(read, body);
        assert_eq!(read.to_bytes().unwrap(), bytes);
        assert_eq!(read.tool().radius_m().to_bits(), body.tool().radius_m().to_bits());
    }
}

/// Files that earlier programs wrote, byte for byte.
#[test]
fn old_files_are_read() {
    let files = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/files");
    let consistent = BodyParts { slip: SlipRule::Consistent, ..body(&cube(), 0.5, 4).parts() };
    for (name, body) in [
        ("version-1", body(&cube(), 0.5, 4)),
        ("version-2", anisotropic(&cube(), 4)),
        ("version-3", Body::new(consistent).unwrap()),
        ("version-4", coupled(&cube(), 4)),
    ] {
        // Programs of that time knew no errors of a fit.
        let mut parts = body.parts();
        parts.provenance.point_errors.clear();
        parts.provenance.potential_errors.clear();
        parts.provenance.interpolation = None;
        // Nor a tank.
        let body = Body::new(parts).unwrap().with_tank(false);
        let path = files.join(name).with_extension("body");
        if std::env::var_os("PALPATE_BLESS").is_some() && !path.exists() {
            body.save(&path).unwrap();
        }
        assert_eq!(Body::open(&path).unwrap(), body, "{name}");
        // What holds no more is still written as before: programs of that time read it.
        assert_eq!(body.to_bytes().unwrap(), std::fs::read(&path).unwrap(), "{name}");
        assert!(!StoredBody::open(&path, None).unwrap().model_header().has_tank(), "{name}");
    }
}

/// How curved the surface is at the test points is read again, at once and patch by patch; where it is told the file has version 7.
#[test]
fn curvatures_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.body");
    let mut parts = coupled(&cube(), 4).parts();
    for (t, p) in parts.coupled.iter_mut().flat_map(|law| &mut law.potentials).enumerate() {
        p.curvature = [1.0 + t as f64, -2.0, 30.0];
    }
    let body = Body::new(parts.clone()).unwrap();
    body.save(&path).unwrap();
    let read = Body::open(&path).unwrap();
    assert_eq!(read, body);
    assert_eq!(read.coupled_law().unwrap().potentials[2].curvature, [3.0, -2.0, 30.0]);
    let stored = StoredBody::open(&path, None).unwrap();
    let mut patch = stored.patch();
    stored.take(&mut patch, body.nodes()[0].position.to_array(), 4, &|| ()).unwrap();
    let near = patch.model().nodes()[0].test_points[0];
    let [_, k2, k3] = patch.model().potentials().at(near, 0).plane_curvature();
    assert!(patch.model().potentials().is_curved() && (k2 + 2.0).hypot(k3 - 30.0) < 1e-9, "{k2} {k3}");
    assert_ne!(body.identity(), coupled(&cube(), 4).identity());
    // Under a ball no more than its own counts.
    parts.tool = Tool::Sphere { radius_m: 0.1 };
    let refused_by_tool = Body::new(parts.clone()).unwrap_err().to_string();
    assert!(refused_by_tool.contains("its curvature is"), "{refused_by_tool}");
    let bytes = body.to_bytes().unwrap();
    let refused = |bytes: &[u8], words: [&str; 2]| {
        let message = Body::from_bytes(bytes).unwrap_err().to_string();
        assert!(words.iter().all(|w| message.contains(w)), "{message}");
    };
    let older = with_header(&bytes, "\"version\":\"7\"", "\"version\":\"6\"");
    refused(&older, ["coupled_curvatures_per_m", "version 6 has no such tensor"]);
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let header: serde_json::Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
    let at = header["coupled_curvatures_per_m"]["data_offsets"][0].as_u64().unwrap() as usize;
    let mut damaged = bytes.clone();
    damaged[8 + length + at..][..8].copy_from_slice(&f64::NAN.to_le_bytes());
    refused(&damaged, ["test point 0", "curvature"]);
    // The same in other tangents.
    let p = &parts.coupled.unwrap().potentials[0];
    let [t1, t2] = p.tangents;
    let seen = p.seen_in([t2, -t1]).unwrap();
    assert_eq!(seen.curvature, [30.0, 2.0, 1.0]);
}

/// Whether a body has the tank, and partial slip, is read again, whatever its law, at once and patch by patch.
#[test]
fn tank_and_partial_slip_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.body");
    for body in bodies() {
        for (tank, partial) in [(true, false), (false, false), (true, true), (false, true)] {
            let body = body.clone().with_tank(tank).with_partial_slip(partial);
            assert_eq!(Body::new(body.parts()).unwrap(), body, "its parts keep both");
            let has = |model: &ContactModel| (model.has_tank(), model.has_partial_slip());
            assert_eq!(has(&body), (tank, partial));
            body.save(&path).unwrap();
            assert_eq!(has(&Body::open(&path).unwrap()), (tank, partial));
            let refined = body.refined(Fineness::sagitta(1e-3)).unwrap().body;
            assert_eq!(has(&refined), (tank, partial));
            let stored = StoredBody::open(&path, None).unwrap();
            assert_eq!(has(stored.model_header()), (tank, partial));
            let mut patch = stored.patch();
            stored.take(&mut patch, body.nodes()[0].position.to_array(), 4, &|| ()).unwrap();
            assert_eq!(has(patch.model()), (tank, partial));
            let written = String::from_utf8_lossy(&body.to_bytes().unwrap()).into_owned();
            let version = |n: u32| written.contains(&format!("\"version\":\"{n}\""));
            assert_eq!(version(6), partial);
            assert_eq!(version(4), !partial && (tank || body.is_coupled()));
        }
    }
}

#[test]
fn identities_are_no_tensors() {
    let all = |a: Tensor| move |inward: &[DVec3]| Some(vec![a; inward.len()]);
    let plain = body(&cube(), 0.5, 4);
    let same = made(&cube(), 0.5, 4, all(tensor::IDENTITY));
    assert!(same == plain && same.is_isotropic() && same.lateral_tensors().is_none());
    assert_eq!(same.to_bytes().unwrap(), plain.to_bytes().unwrap());

    let one = made(&cube(), 0.5, 4, |inward| {
        let mut tensors = vec![tensor::IDENTITY; inward.len()];
        tensors[5] = tensor::along(DVec3::new(1.0, 2.0, 3.0), 2.0, inward[5]).unwrap();
        Some(tensors)
    });
    assert!(one != plain && !one.is_isotropic());
    assert_eq!(one.lateral_tensors().unwrap()[4], tensor::IDENTITY);
    for element in 0..one.elements().len() as u32 {
        let nodes = one.elements()[element as usize].nodes;
        let tensors = nodes.map(|n| one.lateral_tensors().unwrap()[n as usize]);
        assert_eq!(one.element_tensors(element).map(|a| *a), tensors);
    }
    assert_eq!(plain.element_tensors(3), [&tensor::IDENTITY; 3]);
    assert_eq!(one.element_tensors(u32::MAX).map(|a| *a), [one.lateral_tensors().unwrap()[0]; 3]);
}

#[test]
fn the_radius_survives_to_the_last_bit() {
    let mut random = Random(3);
    for _ in 0..2000 {
        let radius = (random.next() >> 11) as f64 / (1u64 << 53) as f64 * 0.05;
        let surface = Surface::build(&cube(), 0.5).unwrap();
        let body = Body::new(BodyParts {
            blends: vec![BlendWeights::own(0); surface.positions().len()],
            surface,
            responses: vec![response(500.0)],
            test_point_nodes: vec![0],
            coupled: None,
            lateral_tensors: None,
            tool: Tool::Sphere { radius_m: radius },
            slip: SlipRule::Paper,
            tank: true,
            partial_slip: false,
            provenance: Provenance::default(),
        })
        .unwrap();
        let read = Body::from_bytes(&body.to_bytes().unwrap()).unwrap();
        assert_eq!(read.tool().radius_m().to_bits(), radius.to_bits());
    }
}

#[test]
fn alignment_does_not_matter() {
    let body = body(&cube(), 0.5, 4);
    let bytes = body.to_bytes().unwrap();
    for shift in 0..8 {
        let moved: Vec<u8> = std::iter::repeat_n(0, shift).chain(bytes.iter().copied()).collect();
        assert_eq!(Body::from_bytes(&moved[shift..]).unwrap(), body);
    }
}

#[test]
fn a_failed_save_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let [first, second, ..] = bodies();
    let path = folder.path().join("x.body");
    first.save(&path).unwrap();

    // A folder can't be replaced by a file, nor a file be made in a folder that is not there.
    let taken = folder.path().join("taken");
    std::fs::create_dir_all(taken.join("inner")).unwrap();
    let message = second.save(&taken).unwrap_err().to_string();
    assert!(message.contains("taken") && message.contains("check that"), "{message}");
    assert!(taken.join("inner").is_dir());
    second.save(&folder.path().join("missing/x.body")).unwrap_err();

    // A provenance that no header can hold is found before anything is touched.
    let surface = Surface::build(&cube(), 0.5).unwrap();
    let wordy = Body::new(BodyParts {
        blends: vec![BlendWeights::own(0); surface.positions().len()],
        surface,
        responses: vec![response(500.0)],
        test_point_nodes: vec![0],
        coupled: None,
        lateral_tensors: None,
        tool: Tool::Point,
        slip: SlipRule::Paper,
        tank: true,
        partial_slip: false,
        provenance: Provenance { spec: Some("x".repeat(5 << 20)), ..Default::default() },
    });
    let message = wordy.unwrap().save(&path).unwrap_err().to_string();
    assert!(message.contains("x.body: metadata `provenance`") && message.contains("shorten"), "{message}");

    assert_eq!(Body::open(&path).unwrap(), first);
    let mut left: Vec<_> =
        std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name()).collect();
    left.sort();
    assert_eq!(left, ["taken", "x.body"], "no temporary file stays behind");

    second.save(&path).unwrap();
    assert_eq!(Body::open(&path).unwrap(), second);
}

#[cfg(unix)]
#[test]
fn a_saved_file_has_ordinary_permissions() {
    use std::os::unix::fs::PermissionsExt;
    let folder = tempfile::tempdir().unwrap();
    let (path, plain) = (folder.path().join("x.body"), folder.path().join("plain"));
    body(&cube(), 0.5, 4).save(&path).unwrap();
    std::fs::write(&plain, "").unwrap();
    let mode = |path: &Path| std::fs::metadata(path).unwrap().permissions().mode();
    assert_eq!(mode(&path), mode(&plain));
}

/// `bytes` with `from` in the header replaced by `to`, which may be longer.
fn with_header(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    let header = std::str::from_utf8(&bytes[8..8 + length]).unwrap();
    assert!(header.contains(from), "{from} in {header}");
    let header = header.replacen(from, to, 1);
    [&(header.len() as u64).to_le_bytes(), header.as_bytes(), &bytes[8 + length..]].concat()
}

#[test]
fn messages_name_the_place_and_the_hint() {
    let bytes = body(&cube(), 0.5, 4).with_tank(false).to_bytes().unwrap();
    let refused = |bytes: &[u8], words: &[&str]| {
        let message = Body::from_bytes(bytes).unwrap_err().to_string();
        assert!(words.iter().all(|w| message.contains(w)), "{message}");
        assert!(!message.contains('\n'), "{message}");
    };
    let changed = |from: &str, to: &str, words: &[&str]| refused(&with_header(&bytes, from, to), words);

    refused(b"", &["header", "too short"]);
    refused(b"solid cube\nfacet normal 0 0 1\n", &["header", "no body file"]);
    refused(&bytes[..bytes.len() - 1], &["tensors", "incomplete"]);
    refused(&[&bytes[..], &[0]].concat(), &["tensors", "incomplete"]);
    changed("\"palpate-body\"", "\"llama\"", &["metadata `schema`", "`llama`", "no body file"]);
    changed("\"version\":\"1\"", "\"version\":\"8\"", &["metadata `version`", "newer palpate", "update"]);
    changed("\"version\":\"1\"", "\"version\":\"-1\"", &["metadata `version`", "`-1`"]);
    changed("\"version\":\"1\"", "\"edition\":\"1\"", &["metadata `version`", "missing"]);
    changed("SI: m, N, J", "mm, N", &["metadata `units`", "mm"]);
    changed("\"slip\":\"paper\"", "\"slip\":\"ice\"", &["metadata `slip`", "ice"]);
    for rule in ["consistent", "exact"] {
        let slip = format!("\"slip\":\"{rule}\"");
        changed("\"slip\":\"paper\"", &slip, &["metadata `slip`", rule, "version 1", "make the body again"]);
        let newer = with_header(&bytes, "\"version\":\"1\"", "\"version\":\"2\"");
        refused(&with_header(&newer, "\"slip\":\"paper\"", &slip), &["metadata `slip`", rule, "version 2"]);
        let newest = with_header(&bytes, "\"version\":\"1\"", "\"version\":\"3\"");
        let read = Body::from_bytes(&with_header(&newest, "\"slip\":\"paper\"", &slip)).unwrap();
        assert_eq!(read.slip().name(), rule);
    }
    let tank = body(&cube(), 0.5, 4).to_bytes().unwrap();
    refused(
        &with_header(&tank, "\"tank\":\"on\"", "\"tank\":\"full\""),
        &["metadata `tank`", "`full`", "`on`"],
    );
    let partial = body(&cube(), 0.5, 4).with_partial_slip(true).to_bytes().unwrap();
    refused(
        &with_header(&partial, "\"partial_slip\":\"on\"", "\"partial_slip\":\"two\""),
        &["metadata `partial_slip`", "`two`", "`on`"],
    );
    changed("radius_m", "radius_mm", &["metadata `tool`", "radius_mm"]);
    changed("\"positions\"", "\"position\"", &["tensor `positions`", "missing"]);
    changed("U32", "I32", &["I32", "U32", "make the body again"]);
    changed(
        "\"twins\":{\"dtype\":\"U32\",\"shape\":[12,3]",
        "\"twins\":{\"dtype\":\"U32\",\"shape\":[9,4]",
        &["tensor `twins`", "[9, 4]", "[12, 3]"],
    );
    let more = "\"twins\":{\"dtype\":\"F64\",\"shape\":[0,7],\"data_offsets\":[0,0]},\"tw";
    changed(
        "\"tw",
        &more.replace("twins", "torque_curves_nm"),
        &["tensor `torque_curves_nm`", "no such tensor"],
    );
    // Offsets whose sum passes 2⁶⁴.
    let wide = "\"a\":{\"dtype\":\"U8\",\"shape\":[18446744073709551615],\"data_offsets\":[0,18446744073709551615]},\"de";
    changed("\"de", wide, &["header"]);

    let numbers = |name: &str, at: usize, value: f64, words: &[&str]| {
        let length = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
        let header: serde_json::Value = serde_json::from_slice(&bytes[8..8 + length]).unwrap();
        let start = 8 + length + header[name]["data_offsets"][0].as_u64().unwrap() as usize + 8 * at;
        let mut bytes = bytes.clone();
        bytes[start..start + 8].copy_from_slice(&value.to_le_bytes());
        refused(&bytes, words);
    };
    numbers("positions", 4, f64::NAN, &["node 1"]);
    numbers("inward_normals", 0, 3.0, &["normal 0", "unit vector"]);
    numbers("node_weights", 3, -0.1, &["node 1", "weights"]);
    numbers("depth_knots_m", 2, 1e-4, &["tensor `depth_knots_m`, deflection 2", "ascending"]);
    numbers("normal_curves_n", 15, 7.0, &["tensor `normal_curves_n`, test point 1, ", "jumps"]);
    numbers("friction_curves", 13, -1.0, &["test point 1", "friction"]);
    numbers("lateral_curves_n", 5, f64::INFINITY, &["tensor `lateral_curves_n`, test point 0"]);

    let stretched = anisotropic(&plane(2, 1), 1).with_tank(false).to_bytes().unwrap();
    refused(
        &with_header(&stretched, "\"version\":\"2\"", "\"version\":\"1\""),
        &["tensor `lateral_tensors`", "version 1 has no such tensor"],
    );
    let length = u64::from_le_bytes(stretched[..8].try_into().unwrap()) as usize;
    for (at, value, words) in [
        (7, f64::NAN, "not finite"),
        (8, 1.1, "acts on the normal"),
        (9, 50.0, "positive"),
        (6, 1.9, "mean 1"),
    ] {
        let mut bytes = stretched.clone();
        // The tensors come first.
        bytes[8 + length + 8 * at..][..8].copy_from_slice(&f64::to_le_bytes(value));
        refused(&bytes, &["node 1", "lateral tensor", words]);
    }

    let coupled = coupled(&cube(), 4).to_bytes().unwrap();
    refused(
        &with_header(&coupled, "\"version\":\"4\"", "\"version\":\"3\""),
        &["tensor `lateral_knots_m`", "missing"],
    );
    refused(
        &with_header(&coupled, "coupled_tangents", "coupled_tangent"),
        &["`coupled_tangents`", "missing"],
    );
    refused(&with_header(&coupled, "[4,12,5,4]", "[4,10,6,4]"), &["`coupled_curves`", "[4, 12, 5, 4]"]);
    let length = u64::from_le_bytes(coupled[..8].try_into().unwrap()) as usize;
    let header: serde_json::Value = serde_json::from_slice(&coupled[8..8 + length]).unwrap();
    for (name, at, value, words) in [
        ("lateral_range_m", 0, 0.0, ["lateral_range_m", "length"]),
        ("lateral_range_m", 0, f64::NAN, ["lateral_range_m", "length"]),
        ("coupled_tangents", 7, f64::NAN, ["test point 1", "tangents"]),
        ("coupled_tangents", 7, 0.5, ["test point 1", "tangents"]),
        // Quantities have 20 ordinates each, test points 240.
        ("coupled_curves", 240 + 60, f64::NAN, ["test point 1, K11", "usable"]),
        ("coupled_curves", 240 + 63, 0.1, ["test point 1, K11", "jumps"]),
        ("coupled_curves", 240 + 65, -90.0, ["test point 1", "slope of K11 jumps at a depth of 0.500 mm"]),
        ("coupled_curves", 220, -1.0, ["test point 0", "friction"]),
    ] {
        let start = 8 + length + header[name]["data_offsets"][0].as_u64().unwrap() as usize + 8 * at;
        let mut bytes = coupled.clone();
        bytes[start..start + 8].copy_from_slice(&f64::to_le_bytes(value));
        refused(&bytes, &words);
    }

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.body");
    std::fs::write(&path, &bytes[..100]).unwrap();
    let message = Body::open(&path).unwrap_err().to_string();
    assert!(message.contains("x.body: header"), "{message}");
    std::fs::write(&path, "").unwrap();
    Body::open(&path).unwrap_err();
    let message = Body::open(folder.path()).unwrap_err().to_string();
    assert!(message.contains("no ordinary file"), "{message}");
    let message = Body::open(&folder.path().join("none")).unwrap_err().to_string();
    assert!(message.contains("none") && message.contains("check that"), "{message}");
}

/// A coupled body in its file gives the patches of one in memory, to the bit.
#[test]
fn a_coupled_patch_out_of_the_file_is_that_of_the_body_in_memory() {
    let mut random = Random(7);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.body");
    for body in [coupled(&plane(12, 9), 130), coupled(&plane(12, 9), 5), coupled(&cube(), 3)] {
        for rule in SlipRule::ALL {
            body.save(&path).unwrap();
            let whole = Body::open(&path).unwrap();
            whole.prepare(rule);
            let stored = StoredBody::open(&path, Some(rule)).unwrap();
            assert!(stored.model_header().is_coupled());
            let (mut read, mut copied) = (stored.patch(), whole.patch());
            for _ in 0..20 {
                let at = body.nodes()[random.below(body.nodes().len())].position.to_array();
                let count = 1 + random.below(body.elements().len());
                stored.take(&mut read, at, count, &|| ()).unwrap();
                copied.take(&whole, at, count);
                let [a, b] = [&read, &copied].map(|p| p.model().clone());
                assert_eq!(a, b);
                assert_eq!(a.gradients(), b.gradients());
                assert_eq!(a.gradients().is_some(), rule == SlipRule::Consistent);
                // Nothing of it is the decoupled law's.
                assert!(a.is_coupled() && !a.potentials().is_empty() && a.responses().is_empty());
            }
            let mut seen = Vec::new();
            stored.each_potential(&mut |p| seen.push(p.clone())).unwrap();
            assert_eq!(seen, whole.coupled_law().unwrap().potentials);
            stored.each_response(&mut |_| panic!("a coupled law has no responses")).unwrap();
        }
    }
}

/// xorshift64*
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }
}

fn mutate(bytes: &mut Vec<u8>, random: &mut Random) {
    let header = u64::from_le_bytes(bytes[..8].try_into().unwrap_or([0; 8])) as usize;
    let header = header.min(bytes.len() - 8).max(1);
    match random.below(8) {
        0 => {
            let at = random.below(bytes.len());
            bytes[at] ^= 1 << random.below(8);
        }
        1 => bytes.truncate(8 + random.below(bytes.len() - 8)),
        // A digit more in the header, with the length that goes with it: shapes, offsets, radius.
        2 | 3 => {
            let digits: Vec<usize> =
                (8..8 + header).filter(|&i| bytes.get(i).is_some_and(u8::is_ascii_digit)).collect();
            if digits.is_empty() {
                return;
            }
            let at = digits[random.below(digits.len())];
            let digit = b'0' + random.below(10) as u8;
            if random.below(2) == 0 {
                bytes[at] = digit;
            } else {
                bytes.insert(at, digit);
                bytes[..8].copy_from_slice(&(header as u64 + 1).to_le_bytes());
            }
        }
        4 | 5 => {
            let length = 1 + random.below(64.min(bytes.len() / 3));
            let (from, to) = (random.below(bytes.len() - length), random.below(bytes.len() - length));
            let block = bytes[from..from + length].to_vec();
            if random.below(2) == 0 {
                let other = bytes[to..to + length].to_vec();
                bytes[from..from + length].copy_from_slice(&other);
            }
            bytes[to..to + length].copy_from_slice(&block);
        }
        6 => {
            let at = 8 + header + 8 * random.below((bytes.len() - 8 - header).max(8) / 8);
            let values = [f64::NAN, f64::INFINITY, -1.0, 0.0, 1e300, 1e-300, -1e12, 1e9, 0.5, 1e-12];
            if let Some(number) = bytes.get_mut(at..at + 8) {
                number.copy_from_slice(&values[random.below(values.len())].to_le_bytes());
            }
        }
        _ => {
            let at = 8 + header + 4 * random.below((bytes.len() - 8 - header).max(4) / 4);
            let values = [u32::MAX, u32::MAX - 1, 0, 1, 35, 36, 1 << 31, random.next() as u32 % 40];
            if let Some(number) = bytes.get_mut(at..at + 4) {
                number.copy_from_slice(&values[random.below(values.len())].to_le_bytes());
            }
        }
    }
}

#[test]
fn no_damage_gets_in() {
    let originals = bodies().map(|b| b.to_bytes().unwrap());
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let mut accepted = 0;
    let folder = tempfile::tempdir().unwrap();
    for round in 0..100_000 {
        let mut bytes = originals[round % originals.len()].clone();
        for _ in 0..1 + random.below(3) {
            if bytes.len() > 64 {
                mutate(&mut bytes, &mut random);
            }
        }
        let body = Body::from_bytes(&bytes);
        if round % 23 < 4 {
            // Nor where the body stays in its file: a new one each time, since systems put what replaces a file on the disk at once.
            let path = folder.path().join(format!("{round}.body"));
            std::fs::write(&path, &bytes).unwrap();
            match (&body, StoredBody::open(&path, Some(SlipRule::Paper))) {
                (Ok(body), Ok(stored)) => {
                    let mut patch = stored.patch();
                    stored.take(&mut patch, [0.0; 3], 5, &|| ()).unwrap();
                    let same = palpate_body::Patch::new(body, [0.0; 3], 5);
                    assert_eq!(patch.model(), same.model(), "round {round}");
                }
                (Err(_), Err(_)) => {}
                (_, Err(e)) => assert!(e.to_string().contains("aligned"), "round {round}: {e}"),
                (Err(e), _) => panic!("round {round}: {e}"),
            }
            std::fs::remove_file(&path).unwrap();
        }
        if let Ok(body) = body {
            accepted += 1;
            let written = body.to_bytes().unwrap();
            assert_eq!(Body::from_bytes(&written).unwrap(), body, "round {round}");
        }
    }
    println!("{accepted} of 100,000 damaged files were sound, the largest block had {} bytes", LARGEST.get());
    assert!(accepted < 30_000, "{accepted} of 100,000 damaged files were taken for sound");
    assert!(LARGEST.get() < 1 << 20, "a damaged file made the reader ask for too much memory");
}

#[test]
fn damage_while_it_is_in_use_is_an_error_or_another_patch() {
    let folder = tempfile::tempdir().unwrap();
    let mut random = Random(0x2545_F491_4F6C_DD1D);
    let (mut refused, mut taken) = (0, 0);
    for (round, body) in (0..4000).zip(bodies().iter().cycle()) {
        let sound = body.to_bytes().unwrap();
        let path = folder.path().join(format!("{round}-x.body"));
        std::fs::write(&path, &sound).unwrap();
        let stored = StoredBody::open(&path, Some(SlipRule::Consistent)).unwrap();
        let mut patch = stored.patch();
        stored.take(&mut patch, [0.0; 3], 5, &|| ()).unwrap();

        let mut bytes = sound.clone();
        for _ in 0..3 {
            mutate(&mut bytes, &mut random);
            bytes.resize(sound.len(), 0);
        }
        let file = std::fs::File::options().write(true).open(&path).unwrap();
        let before = file.metadata().unwrap().modified().unwrap();
        std::io::Write::write_all(&mut &file, &bytes).unwrap();
        // As if nothing had happened: the worst that can.
        file.set_modified(before).unwrap();
        match stored.take(&mut patch, [0.0; 3], 5, &|| ()) {
            Ok(()) => taken += 1,
            Err(e) => {
                refused += 1;
                assert!(e.to_string().contains("x.body"), "round {round}: {e}");
            }
        }
        std::fs::remove_file(&path).unwrap();
    }
    assert!(refused > 200 && taken > 200, "{refused} {taken}");
}

#[test]
fn a_body_in_its_file_holds_a_tenth_of_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.body");
    let body = body(&plane(400, 400), 0.5, 50);
    body.save(&path).unwrap();
    let file = std::fs::metadata(&path).unwrap().len() as f64 / body.elements().len() as f64;
    let each = |bytes: isize| (bytes - (1 << 20)) as f64 / body.elements().len() as f64;
    let (stored, held, peak) = memory_of(|| StoredBody::open(&path, Some(SlipRule::Consistent)).unwrap());
    let [held, peak] = [held, peak].map(each);
    let (_, _, patch) = memory_of(|| {
        let mut patch = stored.patch();
        stored.take(&mut patch, [0.1, 0.1, 0.0], 8192, &|| ()).unwrap();
        patch
    });
    let (whole, _, opened) = memory_of(|| Body::open(&path).unwrap());
    println!(
        "bytes an element: file {file}, in its file {held}, {peak} as it opens; in memory {}",
        each(opened)
    );
    println!("a patch as it is made: {patch} bytes");
    assert!(file > 65.0 && held < 8.0 && peak < 10.0 && each(opened) > 100.0);
    assert!(patch < 16 << 20);
    drop(whole);
}

#[test]
fn a_body_that_cant_stay_in_its_file_says_why() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.body");
    let refused = |bytes: &[u8], slip: Option<SlipRule>, words: &[&str]| {
        std::fs::write(&path, bytes).unwrap();
        Body::open(&path).unwrap();
        let message = StoredBody::open(&path, slip).unwrap_err().to_string();
        assert!(words.iter().all(|w| message.contains(w)) && message.contains("x.body"), "{message}");
    };
    let bytes = body(&cube(), 0.5, 4).to_bytes().unwrap();
    assert_eq!(bytes.len() % 8, 0);
    refused(&with_header(&bytes, "repaired", "mended"), None, &["tensor `", "not aligned", "in memory"]);

    // Two squares that share a corner, and one node there for both.
    let mut squares = plane(2, 2);
    squares.triangles = [0, 1, 6, 7].map(|t| squares.triangles[t]).to_vec();
    let used = |v: &u32| squares.triangles.iter().any(|t| t.contains(v));
    let kept: Vec<u32> = (0..9).filter(used).collect();
    squares.positions = kept.iter().map(|&v| squares.positions[v as usize]).collect();
    let renumbered = |v| kept.iter().position(|&k| k == v).unwrap() as u32;
    squares.triangles = squares.triangles.iter().map(|t| t.map(renumbered)).collect();
    let apart = body(&squares, 0.5, 2);
    assert_eq!((apart.nodes().len(), apart.vertex_count()), (8, 7));
    StoredBody::open(
        {
            apart.save(&path).unwrap();
            &path
        },
        Some(SlipRule::Consistent),
    )
    .unwrap();
    let mut bytes = apart.to_bytes().unwrap();
    let elements: Vec<u8> =
        apart.elements().iter().flat_map(|e| e.nodes).flat_map(u32::to_le_bytes).collect();
    let at = bytes.windows(elements.len()).position(|w| w == elements).unwrap();
    let shared = apart.elements()[0].nodes.iter().chain(&apart.elements()[1].nodes);
    let shared =
        *shared.max_by_key(|n| (apart.nodes()[**n as usize].position.length() * 1e6) as u64).unwrap();
    for number in bytes[at..at + elements.len()].chunks_exact_mut(4).filter(|n| **n == 7u32.to_le_bytes()) {
        number.copy_from_slice(&shared.to_le_bytes());
    }
    let place = format!("node {shared}");
    refused(&bytes, Some(SlipRule::Consistent), &[&place, "no edge joins", "in memory"]);
    StoredBody::open(&path, None).unwrap();
}

/// Run with `--ignored --nocapture`: time and memory of a large body.
#[test]
#[ignore = "takes gigabytes"]
fn five_million_elements() {
    let body = body(&plane(1582, 1582), 0.5, 1000);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("large.body");
    let clock = std::time::Instant::now();
    body.save(&path).unwrap();
    println!("{} elements saved in {:?}", body.elements().len(), clock.elapsed());
    drop(body);
    let resident = |key: &str| {
        let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
        status.lines().find(|l| l.starts_with(key)).map(str::to_owned)
    };
    std::fs::write("/proc/self/clear_refs", "5").ok();
    let clock = std::time::Instant::now();
    let stored = StoredBody::open(&path, Some(SlipRule::Consistent)).unwrap();
    println!(
        "left in its file after {:?}, {:?}, {:?}",
        clock.elapsed(),
        resident("VmHWM"),
        resident("VmRSS")
    );
    let mut patch = stored.patch();
    for (count, centre) in [8192, 8192, 1].into_iter().flat_map(|n| [(n, [0.1; 3]), (n, [0.9; 3])]) {
        let clock = std::time::Instant::now();
        stored.take(&mut patch, centre, count, &|| ()).unwrap();
        println!("a patch of {count} elements read in {:?}", clock.elapsed());
    }
    std::fs::write("/proc/self/clear_refs", "5").ok();
    let clock = std::time::Instant::now();
    let read = Body::open(&path).unwrap();
    read.prepared_gradients();
    println!("opened in {:?}, {:?}, {:?}", clock.elapsed(), resident("VmHWM"), resident("VmRSS"));
    for centre in [[0.1; 3], [0.9; 3]] {
        let clock = std::time::Instant::now();
        read.take(&mut patch, centre, 8192, &|| ()).unwrap();
        println!("a patch of 8192 elements copied in {:?}", clock.elapsed());
    }
    assert_eq!(read.curves().len(), 1000);
}
