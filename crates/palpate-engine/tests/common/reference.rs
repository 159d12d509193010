//! The model written down slowly and obviously: brute-force search, one curve at a time, slip in tiny steps.
#![allow(dead_code, reason = "each test file uses its own part")]

use glam::{DMat3, DVec3};
use palpate_body::{Body, CoupledLaw, Response, SlipRule, tensor};

/// What the force law reads at one contact point.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    pub u: DVec3,
    pub depth: f64,
    pub lateral: f64,
    /// Direction of the lateral force.
    pub u_r: DVec3,
    pub fz: f64,
    pub fr: f64,
    pub limit: f64,
    pub energy: f64,
    /// About how fast f_r falls as c moves along u_r, N/m.
    pub stiffness: f64,
}

impl Reading {
    pub fn force_on_tool(&self) -> DVec3 {
        -(self.u * self.fz + self.u_r * self.fr)
    }
}

pub struct Reference<'a> {
    body: &'a Body,
    rule: SlipRule,
    /// Of the nodes; none with a coupled law.
    responses: Vec<Response>,
    coupled: Option<CoupledLaw>,
    neighbours: Vec<Vec<usize>>,
    contact: Option<(usize, DVec3)>,
    last: Option<DVec3>,
    /// In how many parts the tool goes the way of a sample. Slip with the tool held runs along f_t where it starts, and
    /// under a tensor, or a coupled law, that direction is behind by as much as the tool moves at once.
    parts: u32,
}

impl<'a> Reference<'a> {
    pub fn new(body: &'a Body, rule: SlipRule) -> Self {
        let coupled = body.parts().coupled;
        let nodes = if coupled.is_some() { 0 } else { body.nodes().len() };
        let responses = (0..nodes).map(|n| body.node_response(n).unwrap()).collect();
        let triangles: Vec<[u32; 3]> = body.elements().iter().map(|e| e.nodes).collect();
        let touching = |a: &[u32; 3]| {
            (0..triangles.len()).filter(|&b| triangles[b].iter().any(|n| a.contains(n))).collect::<Vec<_>>()
        };
        let neighbours = triangles.iter().map(touching).collect();
        Reference {
            body,
            rule,
            responses,
            neighbours,
            contact: None,
            last: None,
            parts: if body.is_isotropic() && !body.is_coupled() { 1 } else { 4 },
            coupled,
        }
    }

    fn corners(&self, element: usize) -> [DVec3; 3] {
        self.body.elements()[element].nodes.map(|n| self.body.nodes()[n as usize].position)
    }

    /// Area coordinates of a point in an element's plane, by areas (3).
    pub fn area_coordinates(&self, element: usize, p: DVec3) -> [f64; 3] {
        let [a, b, c] = self.corners(element);
        let normal = (b - a).cross(c - a);
        let area = |p: DVec3, q: DVec3, r: DVec3| (q - p).cross(r - p).dot(normal);
        [area(p, b, c), area(a, p, c), area(a, b, p)].map(|x| x / normal.length_squared())
    }

    /// (1) to (5) at contact point `c` of `element`.
    pub fn read(&self, element: usize, c: DVec3, tip: DVec3) -> Reading {
        let n = self.area_coordinates(element, c);
        let nodes = self.body.elements()[element].nodes.map(|n| n as usize);
        let u = (0..3).map(|l| self.body.nodes()[nodes[l]].inward * n[l]).sum::<DVec3>().normalize();
        let mix = |f: &dyn Fn(&Response) -> f64| -> f64 {
            (0..3).map(|l| n[l] * f(&self.responses[nodes[l]])).sum()
        };
        let delta = tip - c;
        let depth = delta.dot(u) + self.body.tool().radius_m();
        let tangential = delta - u * delta.dot(u);
        let lateral = tangential.length();
        if self.coupled.is_some() {
            return self.read_coupled(nodes, n, u, depth, tangential);
        }
        let fz = if depth > 0.0 { mix(&|r| r.normal.value(depth)) } else { 0.0 };
        let stretched = |l: usize| {
            let tensors = self.body.lateral_tensors();
            tensors.map_or(tangential, |a| tensor::apply(&a[nodes[l]], tangential))
        };
        let stretched = (0..3).map(|l| stretched(l) * n[l]).sum::<DVec3>();
        let rho = stretched.dot(tangential).sqrt();
        let along = stretched - u * stretched.dot(u);
        let fr = mix(&|r| r.lateral.value(rho)) * if rho > 0.0 { along.length() / rho } else { 1.0 };
        let mu = mix(&|r| r.friction.value(depth));
        let stored = if depth > 0.0 { mix(&|r| r.normal.integral(depth)) } else { 0.0 };
        Reading {
            u,
            depth,
            lateral,
            u_r: along.normalize_or_zero(),
            fz,
            fr,
            limit: mu * fz,
            energy: stored + mix(&|r| r.lateral.integral(rho)),
            stiffness: fr / lateral,
        }
    }

    /// The same of a coupled law, by differences of its energies alone.
    fn read_coupled(
        &self,
        nodes: [usize; 3],
        n: [f64; 3],
        u: DVec3,
        depth: f64,
        tangential: DVec3,
    ) -> Reading {
        let energy = |depth: f64, tangential: DVec3| -> f64 {
            (0..3).map(|l| n[l] * self.node_energy(nodes[l], depth, tangential)).sum()
        };
        let h = 1e-8;
        let fz = (energy(depth + h, tangential) - energy(depth - h, tangential)) / (2.0 * h);
        let side = u.any_orthonormal_vector();
        let pull = [side, u.cross(side)].map(|t| {
            t * ((energy(depth, tangential + t * h) - energy(depth, tangential - t * h)) / (2.0 * h))
        });
        let pull = pull[0] + pull[1];
        let u_r = pull.normalize_or_zero();
        let mu: f64 = (0..3).map(|l| n[l] * self.node_friction(nodes[l], depth)).sum();
        let here = energy(depth, tangential);
        let h = 1e-5;
        let bend = energy(depth, tangential + u_r * h) - 2.0 * here + energy(depth, tangential - u_r * h);
        Reading {
            u,
            depth,
            lateral: tangential.length(),
            u_r,
            fz,
            fr: pull.length(),
            limit: mu * fz.max(0.0),
            energy: here,
            stiffness: bend / (h * h),
        }
    }

    /// W of a node's own potentials, J: LAW 2, with the second-order expansion at the rim beyond the range.
    fn node_energy(&self, node: usize, depth: f64, tangential: DVec3) -> f64 {
        let law = self.coupled.as_ref().unwrap();
        self.mixed_of(node, |t| {
            let potential = &law.potentials[t];
            let [x, y] = potential.tangents.map(|t| t.dot(tangential));
            let [f, b1, b2, k11, k12, k22, c111, c112, c122, c222, q, _] =
                potential.curves().map(|curve| curve.value(depth));
            let cubic = ((c111 * x + c112 * y) * x + c122 * y * y) * x + c222 * y * y * y;
            let r = tangential.length();
            // r³ and r⁴ go on from the rim.
            let (rim, over) = (r.min(law.range_m), (r - law.range_m).max(0.0));
            let r3 = rim.powi(3) + 3.0 * rim * rim * over + 3.0 * rim * over * over;
            let r4 = rim.powi(4) + 4.0 * rim.powi(3) * over + 6.0 * (rim * over).powi(2);
            let cubic = if r > law.range_m { cubic * (r3 / r.powi(3)) } else { cubic };
            f + b1 * x + b2 * y + 0.5 * (k11 * x * x + 2.0 * k12 * x * y + k22 * y * y) + cubic + q * r4
        })
    }

    fn node_friction(&self, node: usize, depth: f64) -> f64 {
        let law = self.coupled.as_ref().unwrap();
        self.mixed_of(node, |t| law.potentials[t].friction.value(depth))
    }

    fn mixed_of(&self, node: usize, of: impl Fn(usize) -> f64) -> f64 {
        let node = &self.body.nodes()[node];
        (0..3)
            .filter(|&i| node.weights[i] > 0.0)
            .map(|i| node.weights[i] * of(node.test_points[i] as usize))
            .sum()
    }

    /// The vector that slip follows. Energies are differenced here at the tool held, and no formula of the engine's is used.
    pub fn drive(&self, reading: &Reading, element: usize, c: DVec3, tip: DVec3) -> DVec3 {
        match self.rule {
            SlipRule::Exact => {
                let slope = -self.slope(element, |c| self.read(element, c, tip).energy, c);
                self.motion(reading, element, c).inverse() * slope
            }
            SlipRule::Consistent => {
                let p_u = |v: DVec3| v - reading.u * v.dot(reading.u);
                // What W loses while û alone turns, or A, or the curves change: the law at other places, averaged.
                let n = self.area_coordinates(element, c);
                let nodes = self.body.elements()[element].nodes.map(|n| n as usize);
                let mut sum = DVec3::ZERO;
                for l in 0..3 {
                    let gradient =
                        self.nodal(nodes[l], |l, _| self.curves_at(l, tip - c, reading.u, element, n));
                    let u = self.body.nodes()[nodes[l]].inward;
                    sum += n[l] * (gradient - u * (0.5 * reading.u.dot(gradient)));
                    sum += n[l] * self.nodal(nodes[l], |_, u| self.turned(u, element, n, tip - c));
                }
                self.motion(reading, element, c).inverse() * (reading.u_r * reading.fr - p_u(sum))
            }
            _ => reading.u_r * reading.fr,
        }
    }

    /// How the tool moves with the contact point, M = 1 + (R − δz) κ in the plane of the drive, by the columns; R − δz counts between
    /// −R/2 and R.
    fn motion(&self, reading: &Reading, element: usize, c: DVec3) -> DMat3 {
        let Some(law) = self.coupled.as_ref().filter(|_| self.rule != SlipRule::Paper) else {
            return DMat3::IDENTITY;
        };
        let (n, [p, q, r]) = (self.area_coordinates(element, c), self.corners(element));
        let exact = self.rule == SlipRule::Exact;
        let normal = if exact { (q - p).cross(r - p).normalize() } else { reading.u };
        let nodes = self.body.elements()[element].nodes.map(|n| n as usize);
        let radius = self.body.tool().radius_m();
        let in_plane = |v: DVec3| v - normal * v.dot(normal);
        let column = |axis: DVec3| {
            let v = in_plane(axis);
            let turned = |t: usize, i: usize| {
                let ([k1, k2, k3], tangents) = (law.potentials[t].curvature, law.potentials[t].tangents);
                let [x, y] = tangents.map(|t| t.dot(v));
                (tangents[0] * (k1 * x + k2 * y) + tangents[1] * (k2 * x + k3 * y))[i]
            };
            let each = |i| (0..3).map(|l| n[l] * self.mixed_of(nodes[l], |t| turned(t, i))).sum();
            let turned: DVec3 = DVec3::new(each(0), each(1), each(2));
            axis + in_plane(turned) * (radius - reading.depth).clamp(-0.5 * radius, radius)
        };
        DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z))
    }

    /// W of the element's law with the curves of node `l` alone and, so that tensors count, ½ of its tensor's share.
    fn curves_at(&self, l: usize, delta: DVec3, u: DVec3, element: usize, n: [f64; 3]) -> f64 {
        let depth = delta.dot(u) + self.body.tool().radius_m();
        let tangential = delta - u * delta.dot(u);
        if self.coupled.is_some() {
            return self.node_energy(l, depth, tangential);
        }
        let a = self.mixed_tensor(element, n, tangential);
        let rho = a.dot(tangential).sqrt();
        let stored = if depth > 0.0 { self.responses[l].normal.integral(depth) } else { 0.0 };
        let own = self.body.lateral_tensors().map_or(tangential, |a| tensor::apply(&a[l], tangential));
        let nodes = self.body.elements()[element].nodes;
        let fr: f64 = (0..3).map(|i| n[i] * self.responses[nodes[i] as usize].lateral.value(rho)).sum();
        let half = if rho > 0.0 { 0.5 * fr / rho } else { 0.0 };
        stored + self.responses[l].lateral.integral(rho) + half * own.dot(tangential)
    }

    fn mixed_tensor(&self, element: usize, n: [f64; 3], v: DVec3) -> DVec3 {
        let nodes = self.body.elements()[element].nodes;
        let tensors = self.body.lateral_tensors();
        (0..3).map(|i| tensors.map_or(v, |a| tensor::apply(&a[nodes[i] as usize], v)) * n[i]).sum()
    }

    /// b·u/|Σnu| for a node's frame u, with b from how W changes when û is turned a little and everything else held.
    fn turned(&self, own: DVec3, element: usize, n: [f64; 3], delta: DVec3) -> f64 {
        let nodes = self.body.elements()[element].nodes.map(|n| n as usize);
        let frame = (0..3).map(|i| self.body.nodes()[nodes[i]].inward * n[i]).sum::<DVec3>();
        let energy = |u: DVec3| -> f64 {
            let depth = delta.dot(u) + self.body.tool().radius_m();
            let tangential = delta - u * delta.dot(u);
            if self.coupled.is_some() {
                return (0..3).map(|i| n[i] * self.node_energy(nodes[i], depth, tangential)).sum();
            }
            let rho = self.mixed_tensor(element, n, tangential).dot(tangential).sqrt();
            let one = |r: &Response| {
                (if depth > 0.0 { r.normal.integral(depth) } else { 0.0 }) + r.lateral.integral(rho)
            };
            (0..3).map(|i| n[i] * one(&self.responses[nodes[i]])).sum()
        };
        // The direction in which this node's frame pulls û.
        let u = frame.normalize();
        let pull = (own - u * own.dot(u)) / frame.length();
        if pull.length() < 1e-9 {
            return 0.0;
        }
        let (h, way) = (1e-5, pull.normalize());
        let at = |s: f64| energy((u + way * s).normalize());
        (at(h) - at(-h)) / (2.0 * h) * pull.length()
    }

    /// Area-weighted mean over the elements around a node of Σ x_j ∇n_j, each turned into the node's tangent plane; `x` is
    /// given the node and its frame, as far as it lies in the element, turned likewise.
    fn nodal(&self, node: usize, x: impl Fn(usize, DVec3) -> f64) -> DVec3 {
        let (mut sum, mut areas) = (DVec3::ZERO, 0.0);
        for (e, element) in self.body.elements().iter().enumerate() {
            if !element.nodes.contains(&(node as u32)) {
                continue;
            }
            let [a, b, c] = self.corners(e);
            let twice = (b - a).cross(c - a);
            let normal = -twice.normalize();
            let turn = glam::DQuat::from_rotation_arc(normal, self.body.nodes()[node].inward);
            let values = element.nodes.map(|n| {
                let u = self.body.nodes()[n as usize].inward;
                x(n as usize, turn * (u - normal * u.dot(normal)))
            });
            let gradient = self.slope(
                e,
                |p| {
                    let n = self.area_coordinates(e, p);
                    (0..3).map(|j| n[j] * values[j]).sum()
                },
                (a + b + c) / 3.0,
            );
            sum += turn * gradient * twice.length();
            areas += twice.length();
        }
        sum / areas
    }

    /// The gradient of a function over an element's plane.
    fn slope(&self, element: usize, x: impl Fn(DVec3) -> f64, c: DVec3) -> DVec3 {
        let [a, b, d] = self.corners(element);
        let s = (b - a).normalize();
        let t = (b - a).cross(d - a).normalize().cross(s);
        let h = 1e-7;
        [s, t].map(|v| v * ((x(c + v * h) - x(c - v * h)) / (2.0 * h))).into_iter().sum()
    }

    /// One sample of a point tool; the force on it.
    pub fn step(&mut self, tip: DVec3) -> DVec3 {
        let from = self.last.replace(tip);
        if self.contact.is_none() {
            self.contact = from.and_then(|from| self.onset(from, tip));
        }
        let Some((mut element, mut c)) = self.contact else { return DVec3::ZERO };
        let start = from.unwrap_or(tip);
        for part in 1..=self.parts {
            let gone = f64::from(part) / f64::from(self.parts);
            (element, c) = self.slip(element, c, start + (tip - start) * gone);
        }
        let reading = self.read(element, c, tip);
        if reading.depth <= 0.0 {
            self.contact = None;
            return DVec3::ZERO;
        }
        self.contact = Some((element, c));
        reading.force_on_tool()
    }

    pub fn contact(&self) -> Option<(usize, DVec3)> {
        self.contact
    }

    /// The first face that the segment enters, of all of them.
    fn onset(&self, from: DVec3, to: DVec3) -> Option<(usize, DVec3)> {
        let mut first: Option<(f64, usize)> = None;
        for element in 0..self.body.elements().len() {
            let [a, b, c] = self.corners(element);
            let normal = (b - a).cross(c - a);
            let (height, speed) = ((from - a).dot(normal), (to - from).dot(normal));
            if speed < 0.0 && height >= 0.0 && height <= -speed {
                let t = -height / speed;
                let inside =
                    self.area_coordinates(element, from + (to - from) * t).iter().all(|&n| n >= -1e-12);
                if inside && first.is_none_or(|f| t < f.0) {
                    first = Some((t, element));
                }
            }
        }
        first.map(|(t, element)| (element, from + (to - from) * t))
    }

    /// ċ along P u_r while f_r > L, in steps that are a small part of what is left.
    fn slip(&self, mut element: usize, mut c: DVec3, tip: DVec3) -> (usize, DVec3) {
        for _ in 0..20_000 {
            let reading = self.read(element, c, tip);
            let drive = self.drive(&reading, element, c, tip);
            let excess = drive.length() - reading.limit;
            if excess <= 1e-9 * reading.limit + 1e-11 * reading.stiffness.min(1e12 * reading.fr) {
                break;
            }
            let stiffness = reading.stiffness.max(1.0);
            let motion = self.motion(&reading, element, c);
            let way = (motion.inverse() * drive).normalize_or_zero() * (excess / stiffness / 24.0);
            // Of the elements that hold c, the one in which the projected drive goes inwards.
            let holds = |e: usize| {
                let [a, b, d] = self.corners(e);
                let normal = (b - a).cross(d - a).normalize();
                let velocity = way - normal * way.dot(normal);
                let n = self.area_coordinates(e, c);
                let ahead = self.area_coordinates(e, c + velocity * 1e-3);
                let here = (c - a).dot(normal).abs() < 3e-10 && n.iter().all(|&x| x > -1e-8);
                let stays = (0..3).all(|i| n[i] > 1e-8 || ahead[i] >= n[i] - 1e-15);
                (here && stays).then_some((e, velocity))
            };
            let around = || std::iter::once(element).chain(self.neighbours[element].iter().copied());
            // All of them push back to an edge: the part of the drive along it is left.
            let along_edge = |e: usize| {
                let (n, p) = (self.area_coordinates(e, c), self.corners(e));
                let on = (0..3).filter(|&i| n[i].abs() < 1e-8 && n.iter().all(|&x| x > -1e-8));
                let velocity = on.map(|i| {
                    let edge = (p[(i + 2) % 3] - p[(i + 1) % 3]).normalize();
                    edge * drive.dot((motion * edge).normalize())
                });
                let velocity = velocity.max_by(|a, b| a.length().total_cmp(&b.length()))?;
                let drives = velocity.length() > reading.limit;
                drives.then_some((e, velocity * (way.length() / drive.length())))
            };
            let found = around().find_map(holds).or_else(|| around().find_map(along_edge));
            let Some((e, velocity)) = found else { break };
            element = e;
            // Not past the edge.
            let n = self.area_coordinates(element, c);
            let end = self.area_coordinates(element, c + velocity);
            let part = (0..3)
                .filter(|&i| end[i] < 0.0 && end[i] < n[i])
                .map(|i| n[i].max(0.0) / (n[i] - end[i]))
                .fold(1.0, f64::min);
            let corners = self.corners(element);
            let at: Vec<f64> = (0..3).map(|i| (n[i] + part * (end[i] - n[i])).max(0.0)).collect();
            let sum: f64 = at.iter().sum();
            c = (0..3).map(|i| corners[i] * (at[i] / sum)).sum();
        }
        (element, c)
    }
}
