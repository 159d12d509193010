//! One period of the loop.

use crate::ground::Ground;
use crate::guard::Verdict;
use crate::map::Mapping;
use crate::wrench::{Placement, Wrench};
use crate::{Coupling, Limit, StageCounts, StageFlags, Stages, WorkspaceMap};
use glam::DVec3;
use palpate_device::{Command, Device, Fault, Sample};
use palpate_engine::{Contact, Output, ToolState};

/// The loop on one body with one device.
#[derive(Debug, Clone)]
pub struct HapticLoop {
    contact: Contact,
    mapping: Mapping,
    stages: Stages,
    port: Port,
    counts: StageCounts,
    /// The last sample that was read, and the last pose that the engine was given.
    last: (Sample, ToolState),
    /// The pose before that.
    before: ToolState,
    /// When the engine was last asked, s.
    stepped_s: Option<f64>,
    /// When the device last took a command, s.
    written_s: Option<f64>,
    /// Whether the last command may not have reached the device.
    unwritten: bool,
    stopped: bool,
    /// Whether a change asks for silence in the next period.
    hushed: bool,
}

/// What a period saw and did.
#[derive(Debug, Clone, Copy)]
pub struct Period {
    /// s.
    pub time_s: f64,
    /// What the device said; what it said last where `read` failed.
    pub sample: Sample,
    /// The pose that the engine was given last, in the body's frame: the virtual tool's under a coupling. In this
    /// period if `flags` say [`StageFlags::STEPPED`].
    pub pose: ToolState,
    /// What the engine answered; no force where it was not given a pose.
    pub output: Output,
    /// The command to the device.
    pub command: Command,
    /// What the stages did.
    pub flags: StageFlags,
    /// What `read` reported, or else `write`.
    pub fault: Option<Fault>,
}

/// The engine's port to the loop: its wrench is held from one pose to the next.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Port {
    /// E_out = Σ F_k · (x_(k+1) − x_k) + τ_k · θ_k, on the tool, with θ the rotation vector from one
    /// orientation to the next, J: what was given out.
    pub out_j: f64,
    /// Σ |x_(k+1) − x_k|², m²: half of K_max times this is what sampling alone can let out (MODEL 9 j).
    pub squares_m2: f64,
    /// Σ |θ_k|², rad²: the same for turning.
    pub squares_rad2: f64,
    last: Option<(Placement, Wrench)>,
}

impl Port {
    fn pass(&mut self, tool: Placement, wrench: Wrench) {
        if let Some((before, held)) = self.last {
            let way = before.displacement_to(&tool);
            self.out_j += held.work(&way);
            self.squares_m2 += way.translation.length_squared();
            self.squares_rad2 += way.rotation.length_squared();
        }
        self.last = Some((tool, wrench));
    }
}

impl HapticLoop {
    /// A loop that renders `contact` through `stages`.
    pub fn new(contact: Contact, map: WorkspaceMap, stages: Stages) -> Self {
        HapticLoop {
            contact,
            mapping: Mapping::new(map),
            stages,
            port: Port::default(),
            counts: StageCounts::default(),
            last: (Sample::default(), ToolState::at([0.0; 3])),
            before: ToolState::at([0.0; 3]),
            stepped_s: None,
            written_s: None,
            unwritten: false,
            stopped: false,
            hushed: false,
        }
    }

    /// The contact as it is now.
    pub fn contact(&self) -> &Contact {
        &self.contact
    }

    /// The same, to take it over to another patch of its body: [`PatchHolder::renew`](crate::PatchHolder::renew).
    pub fn contact_mut(&mut self) -> &mut Contact {
        &mut self.contact
    }

    /// The engine's port.
    pub fn port(&self) -> &Port {
        &self.port
    }

    /// The map as it is now: clutching moves its offset.
    pub fn map(&self) -> &WorkspaceMap {
        &self.mapping.map
    }

    /// The stages as they are now.
    pub fn stages(&self) -> &Stages {
        &self.stages
    }

    /// How often the stages did what.
    pub fn counts(&self) -> &StageCounts {
        &self.counts
    }

    /// From the next period on the command goes to zero, which it reaches within two periods, and stays there.
    pub fn stop(&mut self) {
        self.stopped = true;
    }

    /// Ends a stop: the force ramps up anew.
    pub fn resume(&mut self) {
        self.stopped = false;
    }

    /// No force in the next period, within the slew limit; the force ramps up anew afterwards.
    pub(crate) fn hush(&mut self) {
        self.hushed = true;
    }

    /// Other limits. There must be no force: [`HapticLoop::is_silent`].
    pub(crate) fn set_limits(&mut self, force: Limit, torque: Limit) {
        (self.stages.force, self.stages.torque) = (force, torque);
    }

    /// Another contact and coupling, of another body; what was there comes back in their place. There must be no force.
    pub(crate) fn replace_body(&mut self, contact: &mut Contact, coupling: &mut Option<Coupling>) {
        // What was set for the last body goes for this one.
        contact.set_friction_scale(self.contact.friction_scale());
        std::mem::swap(&mut self.contact, contact);
        std::mem::swap(&mut self.stages.coupling, coupling);
        // The way from the last pose to the next belongs to neither.
        self.port.last = None;
    }

    /// Whether the last command was zero, and the device took it.
    pub fn is_silent(&self) -> bool {
        let [force, torque] = [self.stages.force.rendered(), self.stages.torque.rendered()];
        !self.unwritten && force == DVec3::ZERO && torque == DVec3::ZERO
    }

    /// As [`period`](Self::period), for callers who give up at the first fault.
    ///
    /// # Errors
    /// What the device's `read` or `write` reports.
    ///
    /// # Real-time
    /// As bounded as the device's `read` and `write`.
    pub fn step<G: Ground>(
        &mut self,
        ground: &G,
        device: &mut dyn Device,
        now_s: f64,
    ) -> Result<Period, Fault> {
        let period = self.period(ground, device, now_s);
        period.fault.map_or(Ok(period), Err)
    }

    /// One period at `now_s` after the device's opening: read, believe the pose or not, map, step, output stages, write.
    /// A fault, a rejected or stale pose, a held clutch, and a stop bring the force to zero within the slew limit. Where the
    /// device may render something else than it was told (it is idle, it has had no command for too long, or may not have
    /// got the last one), zero follows at once. After each of them the force ramps up anew.
    ///
    /// # Real-time
    /// As bounded as the device's `read` and `write`.
    pub fn period<G: Ground>(&mut self, ground: &G, device: &mut dyn Device, now_s: f64) -> Period {
        let mut flags = self.late(now_s);
        let unread = self.read(device, now_s, &mut flags).err();
        let output = self.render(ground, now_s, &mut flags);
        let drives_rotations = device.capabilities().driven.rotations > 0;
        let command = self.command(now_s, &output, drives_rotations, &mut flags);
        let unwritten = self.write(device, now_s, &command, &mut flags).err();
        self.counts.add(flags);
        let (sample, pose) = self.last;
        Period { time_s: now_s, sample, pose, output, command, flags, fault: unread.or(unwritten) }
    }

    /// Steps a copy of the contact to where the tool would be if it moved on as it did, so that what the next step needs lies in
    /// the caches. Nothing else comes of it.
    ///
    /// # Real-time
    /// A step of the engine.
    pub fn rehearse<G: Ground>(&self, ground: &G) {
        let [last, before] = [self.last.1, self.before].map(|pose| DVec3::from_array(pose.position_m));
        let pose = ToolState { position_m: (last * 2.0 - before).to_array(), ..self.last.1 };
        let mut copy = self.contact.clone();
        std::hint::black_box(ground.step(&mut copy, &pose, 0.0));
    }

    /// A period without reading or stepping: the next command on the way to zero. For a loop that ends, perhaps because
    /// its device can't be read.
    ///
    /// # Errors
    /// What the device's `write` reports.
    ///
    /// # Real-time
    /// As bounded as the device's `write`.
    pub fn fade(&mut self, device: &mut dyn Device, now_s: f64) -> Result<Command, Fault> {
        let period = self.fading(device, now_s);
        period.fault.map_or(Ok(period.command), Err)
    }

    /// As [`fade`](Self::fade), as a period to be recorded.
    pub(crate) fn fading(&mut self, device: &mut dyn Device, now_s: f64) -> Period {
        self.stop();
        let mut flags = self.late(now_s);
        let output = Output { energy: self.contact.energy(), ..Output::default() };
        let drives_rotations = device.capabilities().driven.rotations > 0;
        let command = self.command(now_s, &output, drives_rotations, &mut flags);
        let fault = self.write(device, now_s, &command, &mut flags).err();
        self.counts.add(flags);
        let (sample, pose) = self.last;
        Period { time_s: now_s, sample, pose, output, command, flags, fault }
    }

    /// Whether the device has had no command for too long.
    fn late(&self, now: f64) -> StageFlags {
        let mut flags = StageFlags::default();
        let silent = self.written_s.map_or(0.0, |then| now - then);
        flags.set(StageFlags::LATE, self.stages.silence_s.is_some_and(|most| silent > most));
        flags
    }

    /// The device's sample, and whether its pose is accepted.
    fn read(&mut self, device: &mut dyn Device, now: f64, flags: &mut StageFlags) -> Result<(), Fault> {
        let read = device.read(now);
        flags.set(StageFlags::UNREAD, read.is_err());
        self.last.0 = read?;
        flags.set(StageFlags::IDLE, self.last.0.status.idle);
        let verdict = self.stages.guard.accept(&self.last.0, now);
        flags.set(StageFlags::STEPPED, verdict == Verdict::Accepted);
        flags.set(StageFlags::REFUSED, verdict == Verdict::Refused);
        flags.set(StageFlags::STALE, verdict == Verdict::Stale);
        Ok(())
    }

    /// The engine's answer at the mapped pose, or at the virtual tool that follows it.
    fn render<G: Ground>(&mut self, ground: &G, now: f64, flags: &mut StageFlags) -> Output {
        if !flags.has(StageFlags::STEPPED) {
            return Output { energy: self.contact.energy(), ..Output::default() };
        }
        let mut pose = self.mapping.pose(&self.last.0);
        flags.set(StageFlags::CLUTCHED, self.mapping.is_held());
        if let Some(coupling) = &mut self.stages.coupling {
            pose = coupling.tool(pose.into()).into();
        }
        self.before = std::mem::replace(&mut self.last.1, pose);
        let dt = now - self.stepped_s.unwrap_or(now);
        let Some(output) = ground.step(&mut self.contact, &pose, dt) else {
            flags.unset(StageFlags::STEPPED);
            flags.set(StageFlags::WAITED, true);
            return Output { energy: self.contact.energy(), ..Output::default() };
        };
        self.stepped_s = Some(now);
        self.port.pass(pose.into(), acting(&output));
        output
    }

    /// The coupling's wrench in the place of the body's, from the tool's tip to the handle, into the device's
    /// frame, and through the stages. `drives_rotations` is of the device.
    fn command(
        &mut self,
        now: f64,
        output: &Output,
        drives_rotations: bool,
        flags: &mut StageFlags,
    ) -> Command {
        flags.set(StageFlags::STOPPED, self.stopped);
        // A free tool that waits for its patch feels nothing anyway, and no force has to ramp up afterwards.
        let heard = flags.has(StageFlags::STEPPED) || flags.has(StageFlags::WAITED);
        let unknown = self.unwritten || flags.has(StageFlags::LATE) || flags.has(StageFlags::IDLE);
        if unknown {
            self.stages.reset();
        }
        let hushed = std::mem::take(&mut self.hushed);
        flags.set(StageFlags::CHANGING, hushed);
        let silence = unknown || hushed || !heard || flags.has(StageFlags::CLUTCHED) || self.stopped;
        let mut at_tip = acting(output);
        if let Some(coupling) = self.stages.coupling.as_mut().filter(|_| flags.has(StageFlags::STEPPED)) {
            at_tip = coupling.wrench(at_tip);
        }
        let mut wanted = self.mapping.map.at_handle(&self.last.0.pose, at_tip);
        if !drives_rotations {
            flags.set(StageFlags::TORQUE_DROPPED, wanted.torque != DVec3::ZERO);
            wanted.torque = DVec3::ZERO;
        }
        self.stages.command(now, &self.last.0, wanted, silence, flags)
    }

    fn write(
        &mut self,
        device: &mut dyn Device,
        now: f64,
        command: &Command,
        flags: &mut StageFlags,
    ) -> Result<(), Fault> {
        let written = device.write(command);
        self.unwritten = written.is_err();
        flags.set(StageFlags::UNWRITTEN, self.unwritten);
        if !self.unwritten {
            self.written_s = Some(now);
        }
        written
    }
}

/// What the engine has acting on the tool.
fn acting(output: &Output) -> Wrench {
    Wrench { force: DVec3::from_array(output.force_n), torque: DVec3::from_array(output.torque_nm) }
}
