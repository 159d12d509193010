/* palpate: what a tool feels when it touches a soft body. The C interface.
 *
 * This file is made of the library's sources (bindings/c in palpate's repository); change it there. docs/c.md tells how to link, where to
 * begin, and what is other than in CHAI3D and SOFA.
 *
 * Units and frames. SI: m, rad, s, N, N m, J, with the unit in the name of every member and parameter. Vectors are x y z, quaternions
 * w x y z. A body has a frame of its own, the one of its mesh; tool, contact point and wrench are in it. A device's frame is
 * right-handed: x to the operator's right, y away from him, z up.
 *
 * Statuses. Every call returns a palpate_status, PALPATE_STATUS_OK for done; on any other nothing was done and results are not
 * written, unless the function says otherwise. Calls that can fail in many ways take a palpate_error of the caller's, or null, for the
 * message. What goes wrong in a step (a pose that is not finite) is no status but a flag of its output.
 *
 * Handles. A palpate_body, palpate_contact or palpate_session is a number, passed by value; zero is never open. Using one that was
 * closed is PALPATE_STATUS_CLOSED, one that another thread is using and that is not for both PALPATE_STATUS_BUSY; no call waits for
 * another. Bodies are read by any number of threads, a contact by one at a time, a session by any number.
 *
 * Structs. The first member is struct_size; begin with the struct's INIT macro, as in
 *     palpate_output output = PALPATE_OUTPUT_INIT;
 * A size that is not this version's is PALPATE_STATUS_WRONG_SIZE. Structs that live longer than a call also have abi_version.
 *
 * Pointers. What is not said to be allowed to be null must not be: PALPATE_STATUS_NULL. A pointer must lead to what its type and the
 * function's text say, aligned, for as long as the call lasts, and nobody may change it meanwhile. Strings are UTF-8 and end in a zero.
 *
 * Real time. Each function says whether it may be called from a haptic loop. Those that may never wait, allocate, lock, log, or read a
 * clock or a file, and their work is bounded. The library has no global settings, starts no threads but where a function says so,
 * installs no signal handler or hook, and calls back from no step. No panic or exception leaves it: PALPATE_STATUS_PANIC.
 *
 * MIT OR Apache-2.0.
 */


#ifndef PALPATE_H
#define PALPATE_H

#include <stddef.h>
#include <stdint.h>

/* What each struct begins with: its size, its version, and what stands for nothing said. */
#define PALPATE_ERROR_INIT { (uint32_t)sizeof(palpate_error), 0, { 0 } }
#define PALPATE_BODY_INFO_INIT { (uint32_t)sizeof(palpate_body_info), 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, { 0 }, { 0 }, 0, 0, 0 }
#define PALPATE_TOOL_STATE_INIT { (uint32_t)sizeof(palpate_tool_state), 0, { 0, 0, 0 }, { 1, 0, 0, 0 } }
#define PALPATE_LEDGER_INIT { (uint32_t)sizeof(palpate_ledger), 0, 0, 0, 0, 0, 0, 0 }
#define PALPATE_OUTPUT_INIT \
    { (uint32_t)sizeof(palpate_output), 0, { 0 }, { 0 }, 0, 0, { 0 }, { 0 }, 0, 0, PALPATE_LEDGER_INIT }
#define PALPATE_COUNTERS_INIT { (uint32_t)sizeof(palpate_counters), 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0 }
#define PALPATE_CONTACT_OPTIONS_INIT \
    { (uint32_t)sizeof(palpate_contact_options), PALPATE_ABI_VERSION, 0, 0, 0, 0, 1.0 }
#define PALPATE_PATH_INIT { (uint32_t)sizeof(palpate_path), 0, 0, NULL, NULL, NULL }
#define PALPATE_TRACE_INIT { (uint32_t)sizeof(palpate_trace), 0, NULL, NULL, NULL, NULL, NULL }
#define PALPATE_BODY_ARRAYS_INIT \
    { (uint32_t)sizeof(palpate_body_arrays), PALPATE_ABI_VERSION, NULL, 0, NULL, 0, NULL, 0, \
      (uint32_t)sizeof(palpate_sample_row), 0, 0, -1.0, 0, 0, 0, 0, 0 }
#define PALPATE_RECORD_INIT \
    { (uint32_t)sizeof(palpate_record), 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, { 0 }, { 0 }, { 0 }, 0, 0, { 0 }, \
      { 0 }, { 0 }, { 0 }, { 0 }, { 0 }, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, { 0 }, { 0 }, { 0 }, 0, 0, 0, 0, 0, 0, \
      { 0 }, 0, 0, 0, { 0 }, 0, 0 }
#define PALPATE_OUTCOME_INIT { (uint32_t)sizeof(palpate_outcome), 0, 0, 0, 0, 0, 0, 0, 0, 0, { 0 } }
#define PALPATE_LOOP_DEVICE_INIT { (uint32_t)sizeof(palpate_loop_device), 0, 0, 1000.0, 0, 0, 0 }
#define PALPATE_CERTIFY_OPTIONS_INIT { (uint32_t)sizeof(palpate_certify_options), 0, 0, 0, 1e-3, 0, NULL }
#define PALPATE_CERTIFICATE_INIT \
    { (uint32_t)sizeof(palpate_certificate), 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, { 0 }, 0, 0, 0, 0, 0, { 0 }, 0, 0, 0, 0, 0, 0, 0, \
      0, 0, 0, 0, 0, 0, 0, 0, 0, 0 }
#define PALPATE_DEVICE_INIT \
    { (uint32_t)sizeof(palpate_device), PALPATE_ABI_VERSION, NULL, NULL, NULL, NULL, NULL, NULL, NULL }


// The interface's version. It is raised whenever a struct, a constant or a function's parameters change; functions and constants
// that are only added leave it. Structs that live longer than a call carry it (`abi_version`).
#define PALPATE_ABI_VERSION 2

// `palpate_features`: the drivers of vendors' devices are built in.
#define PALPATE_FEATURE_DEVICES 1

// `palpate_features`: bodies are made from specs (`palpate_body_from_spec`).
#define PALPATE_FEATURE_BUILD 2

// The paper's slip rule.
#define PALPATE_SLIP_PAPER 1

// The paper's rule with the energy's gradient along the surface: the usual one.
#define PALPATE_SLIP_CONSISTENT 2

// Down the energy's own slope: it generates none, and the force clicks where facets meet.
#define PALPATE_SLIP_EXACT 3

// A tip without extent, or another tool that is given by its tip.
#define PALPATE_TOOL_TIP 0

// A sphere, given by its centre.
#define PALPATE_TOOL_SPHERE 1

// The tool touches the body after this step.
#define PALPATE_FLAG_IN_CONTACT 1

// The contact point moved over the surface.
#define PALPATE_FLAG_SLIPPING 2

// A contact began in this step.
#define PALPATE_FLAG_ONSET 4

// A contact ended in this step.
#define PALPATE_FLAG_RELEASED 8

// After a contact that ended, the tool touches elsewhere in the same step.
#define PALPATE_FLAG_REANCHORED 16

// The contact ended because the contact point reached the surface's border.
#define PALPATE_FLAG_BORDER 32

// An edge or vertex holds the contact point: the lateral force may exceed the friction limit.
#define PALPATE_FLAG_BLOCKED 64

// The step's budget was spent before the contact point had come to rest: the force was cut to the limit.
#define PALPATE_FLAG_CAPPED 128

// The tool state can't be used (not finite, beyond 10^4 m, no rotation): no force, and the contact is kept as it was.
#define PALPATE_FLAG_INVALID_POSE 256

// The force was not finite and was replaced by zero.
#define PALPATE_FLAG_CONTAINED 512

// The tool is inside the body without having come through the surface: no force until it has left.
#define PALPATE_FLAG_STARTED_INSIDE 1024

// The contact point waits at the boundary of a session's patch of the body.
#define PALPATE_FLAG_PATCH_BOUNDARY 2048

// The time step was negative or not finite, and counted as 0.
#define PALPATE_FLAG_INVALID_TIME 4096

// The body is not the contact's; no call of this interface lets that happen.
#define PALPATE_FLAG_OTHER_BODY 8192

// Slip waited since it would have given out more energy than the tank held.
#define PALPATE_FLAG_HELD_BACK 16384

// The normal force pulls the tool in; only a coupled law does that.
#define PALPATE_FLAG_PULLING 32768

// `palpate_output.element`: there is no contact.
#define PALPATE_NO_ELEMENT 4294967295

// `palpate_capabilities.basis`: somebody measured the figures, or the device reports them.
#define PALPATE_BASIS_MEASURED 1

// A data sheet states them.
#define PALPATE_BASIS_STATED 2

// They are guesses.
#define PALPATE_BASIS_GUESSED 3

// `palpate_sample.status`: it renders no force, whatever it is commanded.
#define PALPATE_DEVICE_IDLE 1

// It cut the last command to what its motors can.
#define PALPATE_DEVICE_SATURATED 2

// Its motors are warm.
#define PALPATE_DEVICE_WARM 4

// `velocity_m_per_s` is the device's own.
#define PALPATE_DEVICE_HAS_VELOCITY 8

// `angular_velocity_rad_per_s` is the device's own.
#define PALPATE_DEVICE_HAS_ANGULAR_VELOCITY 16

// Force against depth, N against m.
#define PALPATE_NORMAL 1

// Lateral force against lateral deflection, N against m.
#define PALPATE_LATERAL 2

// Friction coefficient against depth, m.
#define PALPATE_FRICTION 3

// Curves pass between samples as monotone cubics.
#define PALPATE_BETWEEN_PCHIP 0

// Curves pass between samples as straight lines.
#define PALPATE_BETWEEN_LINEAR 1

// Its time was over.
#define PALPATE_END_DONE 1

// The device had no more poses.
#define PALPATE_END_ENDED 2

// Somebody asked for it.
#define PALPATE_END_ASKED 3

// An emergency stop.
#define PALPATE_END_EMERGENCY 4

// The device failed.
#define PALPATE_END_DEVICE 5

// The device's pose stayed the same for too long.
#define PALPATE_END_STALE 6

// A period was too late.
#define PALPATE_END_LATE 7

// The contact finder was silent for too long.
#define PALPATE_END_FINDER_SILENT 8

// The body's file gave no more patches.
#define PALPATE_END_BODY 9

// The contact finder ended.
#define PALPATE_END_FINDER_DEAD 10

// The haptic thread panicked; the device was closed.
#define PALPATE_END_PANIC 11

// Bytes of `palpate_outcome.message`.
#define PALPATE_OUTCOME_BYTES 512

// Bytes of a message, its final zero included.
#define PALPATE_MESSAGE_BYTES 1016

// What every call returns: one of `PALPATE_STATUS_...`.
typedef int32_t palpate_status;

// A body: read-only, for any number of threads at a time. Contacts and sessions on it keep what they need when it is closed.
typedef struct palpate_body {
    // 0 is never open.
    uint64_t id;
} palpate_body;

// Where a call writes what was wrong. It belongs to the caller; a null pointer in its place forgoes the message.
typedef struct palpate_error {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // What the call returned.
    palpate_status status;
    // UTF-8 that ends in a zero: what was wrong, where, and how to mend it. Empty after `PALPATE_STATUS_OK`. A message that is too
    // long is cut.
    char message[PALPATE_MESSAGE_BYTES];
} palpate_error;

// What a body is.
typedef struct palpate_body_info {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // The slip rule that the body asks for: `PALPATE_SLIP_...`.
    uint32_t slip_rule;
    // 1 if the body asks for the tank, with which slip gives out no more energy than it has dissipated before.
    uint32_t has_tank;
    // 1 if its law is a coupled potential, 0 if it is curves.
    uint32_t is_coupled;
    // 1 if its lateral response is alike in all directions.
    uint32_t is_isotropic;
    // The tool that its responses hold for: `PALPATE_TOOL_...`.
    uint32_t tool;
    // Radius of that tool's sphere, m; 0 for a tip.
    double tool_radius_m;
    // Nodes: vertices, and those that creases doubled.
    uint64_t nodes;
    // Vertices.
    uint64_t vertices;
    // Triangles.
    uint64_t elements;
    // Test points: places with responses of their own.
    uint64_t test_points;
    // What tells it from another body.
    uint64_t identity;
    // Its box at rest, from here, m.
    double low_m[3];
    // To here, m.
    double high_m[3];
    // How deep its responses were found, m; they go on straight beyond.
    double depth_max_m;
    // The greatest stiffness that it answers with, N/m: what a device must be able to hold.
    double stiffness_max_n_per_m;
    // The greatest lateral stiffness in stick, N/m; 0 with a coupled law, which has none apart from the depth.
    double stiffness_aside_n_per_m;
} palpate_body_info;

// A device in a sampled loop, as certificates ask for it. `PALPATE_LOOP_DEVICE_INIT` has a loop of 1 kHz and zeros;
// `palpate_loop_device_of` fills it for a device by name.
typedef struct palpate_loop_device {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // Viscous damping that is always there, N s/m.
    double damping_n_s_per_m;
    // Rate of the loop, Hz.
    double rate_hz;
    // Greatest error of a measured position, m: 0.87 steps of the encoder at the tool, half a step along each axis.
    double position_error_m;
    // Coulomb friction, N.
    double coulomb_n;
    // Samples by which a force comes late, or parts of one.
    double delay_samples;
} palpate_loop_device;

// For which motions a body is certified, and with how much effort. `PALPATE_CERTIFY_OPTIONS_INIT` is what `palpate certify` takes.
typedef struct palpate_certify_options {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // `PALPATE_SLIP_...`; 0 for the body's own.
    uint32_t slip_rule;
    // Bounds computed for each element and certificate, at most; 0 for the rule's usual number.
    uint32_t evaluations;
    // Threads; 0 for one on each core.
    uint32_t threads;
    // Longest way of the tool from one step to the next, m.
    double step_m;
    // Deepest that the tool goes, m; 0 for the end of the body's responses.
    double depth_m;
    // The device whose loop is judged, too; null for none.
    const struct palpate_loop_device *device;
} palpate_certify_options;

// How far a body from a spec, or its certificate, is. It lives as long as the call of the progress function.
typedef struct palpate_progress {
    // Size of this struct, bytes; set by the library.
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // Test points, or elements, that are done.
    uint64_t points_done;
    // Of how many; 0 as long as that is not known. Where test points are added in rounds it grows.
    uint64_t points;
    // Something that deserves to be said, UTF-8 that ends in a zero; else null.
    const char *message;
} palpate_progress;

// Hears how far it is. It returns 0 to go on, and anything else to end it: what was done is kept in the work folder. Called from threads
// of the library's, one call at a time.
typedef int32_t (*palpate_progress_function)(void *user, const struct palpate_progress *progress);

// What is proved of a body, in numbers. A margin is the least over the whole body, a bound and not a sample: 0 or more is proved. NaN stands
// for what is not known, or not there.
typedef struct palpate_certificate {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // The slip rule that it speaks of: `PALPATE_SLIP_...`.
    uint32_t slip_rule;
    // 1 if it is proved on every element that no slip makes energy out of nothing. A body with the tank gives out no more than it
    // took even where this is 0.
    uint32_t passive_holds;
    // 1 if it is proved on every element that no slip runs away, so that the force does not jump.
    uint32_t snap_free_holds;
    // The energy that a slip takes out, as a share of the forces: proved.
    double passive_margin;
    // The least that was found of it.
    double passive_found;
    // Elements on which it is proved.
    uint64_t passive_proved_elements;
    // Elements on which a state was found that breaks it.
    uint64_t passive_failing_elements;
    // Elements on which neither was found out.
    uint64_t passive_undecided_elements;
    // The element where the least was found; `PALPATE_NO_ELEMENT` if nothing slips.
    uint32_t passive_worst_element;
    // The element where the least of `snap_free_found_n_per_m` was found, or `PALPATE_NO_ELEMENT`.
    uint32_t snap_free_worst_element;
    // The contact point there, m.
    double passive_worst_m[3];
    // The slope with which a slip comes to rest, N/m: proved.
    double snap_free_margin_n_per_m;
    // The least that was found of it, N/m.
    double snap_free_found_n_per_m;
    // Elements on which it is proved.
    uint64_t snap_free_proved_elements;
    // Elements on which a state was found that breaks it, or along a crease.
    uint64_t snap_free_failing_elements;
    // Elements on which neither was found out.
    uint64_t snap_free_undecided_elements;
    // The contact point where the least was found, m.
    double snap_free_worst_m[3];
    // No force changes faster with the tool's position, N/m: proved; NaN where `snap_free_holds` is 0.
    double lipschitz_n_per_m;
    // The greatest that was found of it, N/m.
    double lipschitz_found_n_per_m;
    // The greatest stiffness, N/m.
    double stiffness_max_n_per_m;
    // To this depth it holds, m.
    double depth_m;
    // For tools that go no farther from step to step, m.
    double step_m;
    // Of a coupled law: to this lateral deflection, m; NaN with curves.
    double lateral_m;
    // From this depth on passivity is looked into, m; 0 with curves.
    double passive_from_m;
    // Elements.
    uint64_t elements;
    // Edges over which a contact ends with the force it has.
    uint64_t border_edges;
    // Elements along creases, where the force jumps and passivity is not looked into.
    uint64_t creased_elements;
    // Elements on which friction can hold beyond ten times the lateral curves: not followed so far.
    uint64_t too_far_elements;
    // The greatest stiffness that the device can hold, N/m. NaN, like the three below, without a device, and where its delay or error of
    // position makes it a matter of what is not proved.
    double device_stiffness_limit_n_per_m;
    // The depth down to which no place of the body is stiffer, m; 0 if it is too stiff laterally at any depth.
    double device_depth_limit_m;
    // The normal force up to which no place is as deep, N; NaN with a coupled law.
    double device_force_limit_n;
    // The contact point's way by the tool's, at most; NaN where it was not asked for or is not bounded.
    double device_contact_way_ratio;
    // 1 if the depth limit is all the depth that the responses know.
    uint32_t device_whole_depth;
    // 0.
    uint32_t reserved;
} palpate_certificate;

// How a contact is to be. `PALPATE_CONTACT_OPTIONS_INIT` is what the body asks for.
typedef struct palpate_contact_options {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // `PALPATE_ABI_VERSION`.
    uint32_t abi_version;
    // `PALPATE_SLIP_...`; 0 for the body's own.
    uint32_t slip_rule;
    // 1 keeps slip from giving out energy, 2 lets it; 0 for what the body asks.
    uint32_t tank;
    // Interpolations taken away, as in the paper's section 5: 1 coordinates, 2 responses, 3 both; 0 for none.
    uint32_t ablation;
    // 0.
    uint32_t reserved;
    // What multiplies the body's friction coefficients, 0 to 100.
    double friction_scale;
} palpate_contact_options;

// A contact: all that evolves while one tool touches one body. One thread at a time.
typedef struct palpate_contact {
    // 0 is never open.
    uint64_t id;
} palpate_contact;

// Where the tool is, in the body's frame. `PALPATE_TOOL_STATE_INIT` has the identity for an orientation.
typedef struct palpate_tool_state {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // The tool's reference point: the tip; for a spherical tool its centre, m.
    double position_m[3];
    // Unit quaternion w x y z, body from tool. Responses do not depend on it yet.
    double orientation[4];
} palpate_tool_state;

// Energies since the contact was made, J: work = stored + dissipated + relaxed.
typedef struct palpate_ledger {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // Work of the tool on the body, J.
    double work_j;
    // Energy stored now, J.
    double stored_j;
    // What slip and release took out of it, J, signed.
    double dissipated_j;
    // The part of that by which the energy rose, as a positive sum: what slip generated, J.
    double generated_j;
    // The tank: what slips have dissipated and later ones may give out again, J.
    double tank_j;
    // What internal variables took out, J; 0 as long as no response has any.
    double relaxed_j;
} palpate_ledger;

// One sample of what a device renders, in the body's frame. Of two contact points (partial slip) forces and energies are the mean,
// and what is said of the contact point and its deflections is of the one that holds longer, or else of the one that touches.
typedef struct palpate_output {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // What happened: a sum of `PALPATE_FLAG_...`.
    uint32_t flags;
    // Force on the tool, N.
    double force_n[3];
    // Torque on the tool about its position, N m; zero for the tools there are so far.
    double torque_nm[3];
    // Triangle that is touched; `PALPATE_NO_ELEMENT` without contact, and all below but the energies is 0 then.
    uint32_t element;
    // 0.
    uint32_t reserved;
    // Area coordinates of the contact point in it.
    double area_coordinates[3];
    // The contact point at rest, m.
    double contact_position_m[3];
    // Normal deflection: how deep the tool is, m.
    double delta_z_m;
    // Lateral deflection, m.
    double delta_r_m;
    // Energies.
    struct palpate_ledger energy;
} palpate_output;

// How often things happened since the contact was made.
typedef struct palpate_counters {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // Steps taken.
    uint64_t steps;
    // Contacts begun.
    uint64_t onsets;
    // Steps with slip.
    uint64_t slips;
    // Evaluations of the force law beyond the first of a step; with the crossings at most 512 a step and contact point, of which
    // partial slip has two.
    uint64_t evaluations;
    // Edges crossed.
    uint64_t crossings;
    // Searches of the surface.
    uint64_t queries;
    // Steps in which an edge or vertex held the contact point.
    uint64_t blocked;
    // Steps at a patch's boundary.
    uint64_t fenced;
    // Steps that spent their budget.
    uint64_t capped;
    // Steps in which slip waited for the tank.
    uint64_t held_back;
    // Tool states refused.
    uint64_t invalid_poses;
    // Time steps that counted as 0.
    uint64_t invalid_times;
    // Forces replaced by zero.
    uint64_t contained;
} palpate_counters;

// What a device's function returns: `PALPATE_FAULT_NONE`, another `PALPATE_FAULT_...`, or a positive number, the vendor's own.
typedef int64_t palpate_fault;

// What a device can do, at its handle: filled in by its `open`, which finds size and zeros in it.
typedef struct palpate_capabilities {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // Where the figures come from: `PALPATE_BASIS_...`; `source` says who.
    uint32_t basis;
    // Maker and model, UTF-8 that ends in a zero.
    char name[64];
    // Where the figures come from, UTF-8 that ends in a zero.
    char source[128];
    // The force that it renders in any direction, N; above 0.
    double max_force_n;
    // The torque that it renders about any axis, N m; 0 where rotations are not driven.
    double max_torque_nm;
    // The stiffest wall that it holds, N/m; above 0.
    double max_stiffness_n_per_m;
    // Middle of the box in which the handle can be, m.
    double workspace_centre_m[3];
    // Half that box's extent along each axis, m.
    double workspace_half_extent_m[3];
    // Translations that are sensed, 0 to 3.
    uint32_t sensed_translations;
    // Rotations that are sensed, 0 to 3.
    uint32_t sensed_rotations;
    // Translations that are driven, 0 to 3.
    uint32_t driven_translations;
    // Rotations that are driven, 0 to 3.
    uint32_t driven_rotations;
    // Buttons.
    uint32_t buttons;
    // 1 if `read` waits for the device's next pose and so sets the pace; 0 if the loop does.
    uint32_t sets_pace;
    // Slower than this the device stops or complains, Hz; 0 where it does not.
    double least_hz;
    // What it is made for, Hz.
    double usual_hz;
    // Faster than this brings nothing, Hz.
    double most_hz;
    // How old the velocity is that it reports, s; negative if it reports none.
    double velocity_delay_s;
    // Moving mass, kg.
    double mass_kg;
    // Viscous damping, N s/m.
    double damping_n_s_per_m;
    // Coulomb friction, N.
    double coulomb_n;
    // Smallest step of the position, m.
    double resolution_m;
    // From the pose's sampling to the moment when the force that answers it acts, s, beyond the loop's own hold.
    double delay_s;
    // Time constant of amplifier and motor, s; 0 for none.
    double lag_s;
    // How fast the force can change, N/s; 0 where nothing limits it.
    double slew_n_per_s;
} palpate_capabilities;

// What a device says in one period, in its own frame: right-handed, x to the operator's right, y away from him, z up.
typedef struct palpate_sample {
    // Size of this struct, bytes; set by the library.
    uint32_t struct_size;
    // A sum of `PALPATE_DEVICE_...`.
    uint32_t status;
    // Counts the poses: the same number twice is the same pose twice, which the watchdog for a device that stands still goes by.
    uint64_t sequence;
    // The handle, m.
    double position_m[3];
    // Unit quaternion w x y z, device from handle; the identity where rotations are not sensed.
    double orientation[4];
    // Velocity, m/s, if `status` says so.
    double velocity_m_per_s[3];
    // Angular velocity, rad/s, if `status` says so.
    double angular_velocity_rad_per_s[3];
    // Bit i is button i, 1 while pressed.
    uint32_t buttons;
    // 0.
    uint32_t reserved;
} palpate_sample;

// What a device is to render on the operator's hand, in its own frame.
typedef struct palpate_command {
    // Size of this struct, bytes; set by the library.
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // N.
    double force_n[3];
    // N m; to be left out by devices that drive no rotation.
    double torque_nm[3];
} palpate_command;

// A device of the caller's, as a table of functions. The library copies the table; `user` must live until the session is closed. The
// order of calls is `open`, any number of periods of `read` and `write`, `close`; they come from one thread at a time, `read` and `write`
// from the haptic thread. No function may throw an exception or jump out.
typedef struct palpate_device {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // `PALPATE_ABI_VERSION`.
    uint32_t abi_version;
    // Given to every function.
    void *user;
    // Connects, with no force yet, and fills in what the device can do. If it fails it writes why, and what to do, to `message` (UTF-8
    // that ends in a zero, `message_bytes` at most).
    palpate_fault (*open)(void *user, struct palpate_capabilities *capabilities, char *message, size_t message_bytes);
    // Where the handle is. `now_s` is the loop's time since `open`, s. Real-time: bounded, no allocation, no lock that others hold long.
    palpate_fault (*read)(void *user, double now_s, struct palpate_sample *sample);
    // Renders `command` until the next one. Real-time, as `read`.
    palpate_fault (*write)(void *user, const struct palpate_command *command);
    // Renders no force and disconnects. Called once for every `open` that went well.
    void (*close)(void *user);
    // May be null. Takes the force off an open device at once, from any thread, at any time between `open` and `close`; it waits for
    // nothing.
    void (*emergency_stop)(void *user);
    // May be null. The vendor's words for its own error number, UTF-8 that ends in a zero, `message_bytes` at most.
    void (*explain)(void *user, int64_t code, char *message, size_t message_bytes);
} palpate_device;

// One measured value.
typedef struct palpate_sample_row {
    // Which point of the surface: rows of one point share its number.
    uint32_t point;
    // `PALPATE_NORMAL`, `PALPATE_LATERAL` or `PALPATE_FRICTION`.
    uint32_t component;
    // Where that point is in the body's frame, m; it counts for the surface's nearest node.
    double position_m[3];
    // Depth or lateral deflection, m.
    double deflection_m;
    // N; a friction coefficient has no unit.
    double value;
} palpate_sample_row;

// What a body is made of. `PALPATE_BODY_ARRAYS_INIT` sets size and version, and zeros: a point tool, the usual slip rule with the tank.
typedef struct palpate_body_arrays {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // `PALPATE_ABI_VERSION`.
    uint32_t abi_version;
    // Vertices in the body's frame, m (vertex_count x 3).
    const double *positions_m;
    // How many.
    size_t vertex_count;
    // Vertices of each triangle, counter-clockwise seen from outside (triangle_count x 3).
    const uint32_t *triangles;
    // How many.
    size_t triangle_count;
    // Measured values, in any order (sample_count).
    const struct palpate_sample_row *samples;
    // How many.
    size_t sample_count;
    // Size of a row, bytes: that of `palpate_sample_row`.
    uint32_t sample_size;
    // 1 if the surface may have borders.
    uint32_t is_open;
    // Edges that turn by more than this stay sharp, rad; 0 for none.
    double crease_angle_rad;
    // Friction coefficient of every point if no row gives one; negative for none.
    double default_friction;
    // Radius of the spherical tool that the samples were taken with, m; 0 for a tip.
    double tool_radius_m;
    // `PALPATE_SLIP_...`; 0 for the usual one.
    uint32_t slip_rule;
    // 1 for a body without the tank that keeps slip from giving out energy.
    uint32_t without_tank;
    // How curves pass between samples: `PALPATE_BETWEEN_...`.
    uint32_t between;
    // 0.
    uint32_t reserved;
} palpate_body_arrays;

// A tool's path in the body's frame.
typedef struct palpate_path {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // How many poses.
    size_t count;
    // Their times, s, never decreasing (count). The first pose has a time step of 0.
    const double *times_s;
    // The tool's reference point, m (count x 3).
    const double *positions_m;
    // Unit quaternions w x y z, body from tool (count x 4); null for the identity.
    const double *orientations;
} palpate_path;

// Where a path's results go. Each array has room for the path's count, or is null.
typedef struct palpate_trace {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // Force on the tool, N (count x 3).
    double *forces_n;
    // Torque on the tool, N m (count x 3).
    double *torques_nm;
    // What happened: sums of `PALPATE_FLAG_...` (count).
    uint32_t *flags;
    // Energies after each step, with their sizes (count).
    struct palpate_ledger *energies;
    // All of it, with its size (count): for who wants more than the arrays above.
    struct palpate_output *outputs;
} palpate_trace;

// A session: a device on a body. Any number of threads may read and steer it.
typedef struct palpate_session {
    // 0 is never open.
    uint64_t id;
} palpate_session;

// The latest period of a session. Names end in their units; vectors are in the device's frame where their name begins with `device` or
// `command`, in the body's else.
typedef struct palpate_record {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // 0.
    uint32_t reserved;
    // 1: a period.
    uint32_t kind;
    // What the output stages did: bits as docs/recording.md has them; bit 0 says that the engine was given a pose.
    uint32_t stage_flags;
    // Counts periods from 0.
    uint64_t number;
    // The loop's time, s.
    double time_s;
    // When the period really began, ns since the start.
    uint64_t started_ns;
    // How long after its due time, ns.
    int64_t lateness_ns;
    // Since the period before began, ns; 0 in the first.
    uint64_t period_ns;
    // What stepping and the stages took, without the device, ns.
    uint32_t step_ns;
    // What the device's read took, ns.
    uint32_t read_ns;
    // What the device's write took, ns.
    uint32_t write_ns;
    // What the device reported: 0 nothing, 1 not open, 2 gone, 3 not in time, 4 not understood, 5 an error of the vendor's
    // (`fault_code`), 6 no more poses.
    uint32_t fault;
    // The vendor's number of the error, if `fault` is 5.
    int64_t fault_code;
    // The sample's number.
    uint64_t device_sequence;
    // The handle.
    double device_position_m[3];
    // Its orientation, w x y z.
    double device_orientation[4];
    // Its velocity, if `device_status` says that the device reports one.
    double device_velocity_m_per_s[3];
    // Bit i is button i.
    uint32_t device_buttons;
    // A sum of `PALPATE_DEVICE_...`.
    uint32_t device_status;
    // The pose that the engine was given.
    double tool_position_m[3];
    // Its orientation, w x y z.
    double tool_orientation[4];
    // The engine's force on the tool.
    double force_n[3];
    // The engine's torque on the tool.
    double torque_nm[3];
    // Area coordinates of the contact point.
    double area_coordinates[3];
    // The contact point at rest.
    double contact_position_m[3];
    // Normal deflection.
    double delta_z_m;
    // Lateral deflection.
    double delta_r_m;
    // Triangle that is touched; `PALPATE_NO_ELEMENT` for none.
    uint32_t element;
    // A sum of `PALPATE_FLAG_...`.
    uint32_t engine_flags;
    // Work of the tool on the body so far.
    double work_j;
    // Energy stored now.
    double stored_j;
    // Energy dissipated so far.
    double dissipated_j;
    // The part of it where slip generated energy, as a positive sum.
    double generated_j;
    // Given out at the engine's port so far.
    double out_j;
    // Sum of the squares of the tool's ways so far.
    double squares_m2;
    // What the passivity controller has observed so far; 0 without one.
    double observed_j;
    // The command to the device: force on the hand.
    double command_force_n[3];
    // The command to the device: torque on the hand.
    double command_torque_nm[3];
    // Where the patch that was stepped on was asked for.
    double patch_centre_m[3];
    // Which patch it was; 0 for the whole body.
    uint64_t patch_serial;
    // How many elements it had.
    uint32_t patch_count;
    // 0.
    uint32_t spare_half;
    // Periods so far in which the loop waited for a patch.
    uint64_t patch_waits;
    // Page faults of the haptic thread so far, without the disk.
    uint32_t minor_faults;
    // Page faults of the haptic thread so far, with the disk.
    uint32_t major_faults;
    // The handle's angular velocity, if `device_status` says that the device reports one.
    double device_angular_velocity_rad_per_s[3];
    // Sum of the squares of the tool's rotation vectors so far.
    double squares_rad2;
    // What multiplied the body's friction coefficients.
    double friction_scale;
    // The tank: what slips have dissipated, and later ones may give out again. NaN where no tank holds slip back.
    double tank_j;
    // 0.
    uint64_t spare[2];
    // `PALPATE_SLIP_...`.
    uint32_t slip_rule_code;
    // Of a record in a file; 0 here.
    uint32_t crc;
} palpate_record;

// What became of a session.
typedef struct palpate_outcome {
    // Size of this struct, bytes.
    uint32_t struct_size;
    // Why it ended: `PALPATE_END_...`.
    uint32_t end;
    // 1 if it went as it should: its time was over, the device had no more poses, or somebody asked.
    uint32_t is_well;
    // 1 if what should have been recorded is not all in its file.
    uint32_t is_recording_cut;
    // Periods that were run.
    uint64_t periods;
    // Periods in contact.
    uint64_t periods_in_contact;
    // Periods that began later than a whole period after their time.
    uint64_t overruns;
    // Records that were written to the file.
    uint64_t recorded;
    // The largest force that was commanded, N.
    double force_max_n;
    // The largest torque that was commanded, N m.
    double torque_max_nm;
    // Why it ended, in words: UTF-8 that ends in a zero.
    char message[PALPATE_OUTCOME_BYTES];
} palpate_outcome;

// It went well.
#define PALPATE_FAULT_NONE 0

// The device is not open.
#define PALPATE_FAULT_NOT_OPEN -1

// The device, its connection or its service is gone.
#define PALPATE_FAULT_DISCONNECTED -2

// The device did not answer in time.
#define PALPATE_FAULT_TIMED_OUT -3

// What came can't be understood.
#define PALPATE_FAULT_GARBLED -4

// There are no more poses, and nothing is wrong: the session ends well.
#define PALPATE_FAULT_ENDED -5

// Done.
#define PALPATE_STATUS_OK 0

// A pointer that must not be null is null, or not aligned.
#define PALPATE_STATUS_NULL 1

// A struct's `struct_size` is not the one of this version: set it to the struct's size, as the `..._INIT` macros do.
#define PALPATE_STATUS_WRONG_SIZE 2

// An `abi_version` is not the library's: program and library come from different versions.
#define PALPATE_STATUS_WRONG_VERSION 3

// The handle is of nothing that is open: it was closed, never opened, or is of another kind.
#define PALPATE_STATUS_CLOSED 4

// Another thread is in a call with this handle. Nothing was done; the call may be repeated.
#define PALPATE_STATUS_BUSY 5

// The two contacts are of different bodies.
#define PALPATE_STATUS_OTHER_BODY 6

// A value that can't be; the message says which.
#define PALPATE_STATUS_INVALID 7

// A body, its file, or what it is made from was refused; the message names file and place.
#define PALPATE_STATUS_BODY 8

// A session, its device or a change of it was refused; the message says what to do.
#define PALPATE_STATUS_SESSION 9

// The caller's buffer is too small; what was asked for was cut, and the length it needs is told.
#define PALPATE_STATUS_TOO_SMALL 10

// The caller's progress function asked for the end.
#define PALPATE_STATUS_CANCELLED 11

// The library was built without this (`palpate_features`).
#define PALPATE_STATUS_UNSUPPORTED 12

// No record yet, or no contact: there is nothing to give.
#define PALPATE_STATUS_NOTHING 13

// A defect of the library: a panic was stopped at its border. The handle it was called with may be half changed: close it.
#define PALPATE_STATUS_PANIC 14

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The library's version of the interface, to be compared with the header's `PALPATE_ABI_VERSION`.
// Real-time: O(1).
uint32_t palpate_abi_version(void);

// `PALPATE_STATUS_OK` if the library serves programs that were compiled with a header of version `abi_version`, else
// `PALPATE_STATUS_WRONG_VERSION`. Call it first, as `palpate_check_abi(PALPATE_ABI_VERSION)`.
// Real-time: O(1).
palpate_status palpate_check_abi(uint32_t abi_version);

// The library's version, commit and features, such as "0.1.0 (commit 0123456789ab; features: devices, simulate)": a string that
// lives as long as the library. Real-time: O(1).
const char *palpate_version(void);

// What is built in: a sum of `PALPATE_FEATURE_...`. Real-time: O(1).
uint32_t palpate_features(void);

// Opens the body file at `path` (UTF-8), reads and checks all of it, and writes a handle to `*body`. Bodies that palpate's commands or
// `palpate_body_save` wrote.
// Fails with `PALPATE_STATUS_BODY`: the file can't be read, is damaged, or of a newer version.
// Not real-time: reads the disk, allocates.
palpate_status palpate_body_open(const char *path,
                                 struct palpate_body *body,
                                 struct palpate_error *error);

// The same from the bytes of a body file, of any alignment, which are not needed after the call.
// Not real-time: allocates.
palpate_status palpate_body_from_memory(const uint8_t *bytes,
                                        size_t length,
                                        struct palpate_body *body,
                                        struct palpate_error *error);

// Writes a body to a file, which is replaced only when the new one is whole.
// Fails with `PALPATE_STATUS_BODY`: the file can't be written. Not real-time: writes the disk.
palpate_status palpate_body_save(struct palpate_body body, const char *path, struct palpate_error *error);

// What a body is: sizes, law, tool, box, stiffness.
// Not real-time: it looks at every test point.
palpate_status palpate_body_inspect(struct palpate_body body, struct palpate_body_info *info);

// The greatest stiffness at each depth to which the body's responses were found (its depth knots): writes up to `capacity` depths, m, to
// `depths_m` and stiffnesses, N/m, to `stiffness_n_per_m`, and to `*count` how many there are. Either array may be null.
// `PALPATE_STATUS_TOO_SMALL` if there are more than `capacity`. `palpate_body_certify` certifies
// more than that. Not real-time.
palpate_status palpate_body_stiffness(struct palpate_body body,
                                      double *depths_m,
                                      double *stiffness_n_per_m,
                                      size_t capacity,
                                      size_t *count);

// Copies the surface at rest, as a renderer wants it: to `positions_m` the nodes' places in the body's frame, m (nodes × 3), and to
// `triangles` the elements' nodes, counter-clockwise seen from outside (elements × 3). Sizes are those of `palpate_body_inspect`;
// `node_capacity` and `element_capacity` say for how many there is room. Either array may be null.
// `PALPATE_STATUS_TOO_SMALL` if there are more than room is for. Not real-time.
palpate_status palpate_body_surface(struct palpate_body body,
                                    double *positions_m,
                                    size_t node_capacity,
                                    uint32_t *triangles,
                                    size_t element_capacity);

// Closes a handle. Contacts and sessions on the body keep it for as long as they need it.
// `PALPATE_STATUS_CLOSED` if it was closed before. Not real-time: it may free memory.
palpate_status palpate_body_close(struct palpate_body body);

// What is known, or guessed, of a device by its name, in a loop of `rate_hz`: "bench", "touch", "omni", "desktop", "omega", "delta",
// "sigma", "lambda" or "falcon" (docs/closed-loop.md says what is guessed).
// Fails with `PALPATE_STATUS_INVALID`: no such name, or no such rate. Not real-time.
palpate_status palpate_loop_device_of(const char *name,
                                      double rate_hz,
                                      struct palpate_loop_device *device,
                                      struct palpate_error *error);

// Proves that a body is passive and free of snaps, or shows where it is not: for every element, all depths and all directions of slip, by
// bounds up to rounding (docs/passivity.md). With a device, down to where its sampled loop is passive. `options` may be null.
// `progress` (may be null) hears of elements, and is given `user`.
// Fails with `PALPATE_STATUS_INVALID` (a value) or `PALPATE_STATUS_CANCELLED` (`progress` said so).
// Not real-time: seconds to hours, on threads of its own, which end with the call.
palpate_status palpate_body_certify(struct palpate_body body,
                                    const struct palpate_certify_options *options,
                                    palpate_progress_function progress,
                                    void *user,
                                    struct palpate_certificate *certificate,
                                    struct palpate_error *error);

// Makes a contact on `body`, as `options` say (null for what the body asks for), and writes a handle to `*contact`. It keeps the body
// for as long as it is open. The first step's pose counts as where the tool comes from.
// Not real-time: allocates, and prepares the body for its slip rule if that was not done before.
palpate_status palpate_contact_create(struct palpate_body body,
                                      const struct palpate_contact_options *options,
                                      struct palpate_contact *contact,
                                      struct palpate_error *error);

// One sample: where the tool is (body's frame, m) and how long after the last one (s, finite and not negative), and out comes the
// wrench on it (N, N m). Write a size into `output` once; all else of it is written anew. What is wrong with a pose is no status
// but a flag, and there is no force then.
// Real-time: bounded; never waits, allocates, locks, logs, or reads a clock or a file. A contact that another thread is in gives
// `PALPATE_STATUS_BUSY` at once, and `output` stays as it was.
palpate_status palpate_contact_step(struct palpate_contact contact,
                                    const struct palpate_tool_state *tool,
                                    double dt_s,
                                    struct palpate_output *output);

// A snapshot: another contact of the same body, in the state that this one is in. It can be stepped on its own, and be restored
// from. Close it as any contact. Not real-time: allocates.
palpate_status palpate_contact_snapshot(struct palpate_contact contact,
                                        struct palpate_contact *snapshot);

// Brings `contact` into the state that `snapshot` is in, ledger, counters and settings too; the other way round it takes a snapshot
// into one that is there. `PALPATE_STATUS_OTHER_BODY` if they are of different bodies, and nothing is changed then.
// Real-time: O(1), as `palpate_contact_step`.
palpate_status palpate_contact_restore(struct palpate_contact contact,
                                       struct palpate_contact snapshot);

// Forgets where the tool was: the next pose counts as the first one. What was stored is booked as dissipated.
// Real-time: O(1), as `palpate_contact_step`.
palpate_status palpate_contact_forget(struct palpate_contact contact);

// Multiplies the body's friction coefficients, from the next step on: 0 to 100, else `PALPATE_STATUS_INVALID`.
// Real-time: O(1), as `palpate_contact_step`.
palpate_status palpate_contact_set_friction_scale(struct palpate_contact contact, double scale);

// Goes over to another slip rule, `PALPATE_SLIP_...`.
// Not real-time the first time: it prepares the body for the rule, which allocates.
palpate_status palpate_contact_set_slip_rule(struct palpate_contact contact, uint32_t rule);

// Keeps slip from giving out more energy than it has dissipated (`tank` 1), or lets it (0).
// Real-time: O(1), as `palpate_contact_step`.
palpate_status palpate_contact_set_tank(struct palpate_contact contact, uint32_t tank);

// Two contact points side by side (`partial_slip` 1), as partial slip wants them, or one (0). Switch it in free space: in touch, of
// two the one that holds longer stays, or else the one that touches, and force and ledger may step to its own.
// Real-time: O(1), as `palpate_contact_step`.
palpate_status palpate_contact_set_partial_slip(struct palpate_contact contact,
                                                uint32_t partial_slip);

// Energies since the contact was made, J. Real-time: O(1), as `palpate_contact_step`.
palpate_status palpate_contact_ledger(struct palpate_contact contact, struct palpate_ledger *ledger);

// How often things happened since the contact was made. Real-time: O(1), as `palpate_contact_step`.
palpate_status palpate_contact_counters(struct palpate_contact contact, struct palpate_counters *counters);

// Closes a contact. `PALPATE_STATUS_BUSY` while another thread is in it, `PALPATE_STATUS_CLOSED` if it was closed before.
// Not real-time: it may free memory.
palpate_status palpate_contact_close(struct palpate_contact contact);

// What a device in the caller's program can test its own table with: `PALPATE_STATUS_OK` if it is whole, else
// `PALPATE_STATUS_NULL`, `PALPATE_STATUS_WRONG_SIZE` or `PALPATE_STATUS_WRONG_VERSION`. No function of it is called. Real-time: O(1).
palpate_status palpate_device_check(const struct palpate_device *device,
                                    struct palpate_error *error);

// Makes a body of a surface and measured values: one curve of each kind for every point, placed on the surface, and every other
// node a blend of the points around it. The mesh is repaired as `palpate fit` does (vertices welded, triangles turned). The arrays are
// not needed after the call.
// Fails with `PALPATE_STATUS_INVALID` (a value) or `PALPATE_STATUS_BODY` (mesh or samples; the message's "line" counts samples from 1).
// Not real-time: allocates.
palpate_status palpate_body_from_arrays(const struct palpate_body_arrays *arrays,
                                        struct palpate_body *body,
                                        struct palpate_error *error);

// Makes a body from the spec at `spec_path` (docs/spec.md; UTF-8): of its law at once, or by simulating its test points by finite elements,
// on `threads` threads (0: one for each core). Finished points are kept in `work_folder`, and a call with the same folder and spec goes
// on with them; with null a folder of the system's for temporary files is used and removed. `progress` (may be null) hears how far it
// is, and is given `user`.
// Fails with `PALPATE_STATUS_BODY` (the spec; the message names its line), `PALPATE_STATUS_CANCELLED` (`progress` said so),
// `PALPATE_STATUS_UNSUPPORTED` (built without `PALPATE_FEATURE_BUILD`). Not real-time: from seconds to hours.
palpate_status palpate_body_from_spec(const char *spec_path,
                                      const char *work_folder,
                                      uint32_t threads,
                                      palpate_progress_function progress,
                                      void *user,
                                      struct palpate_body *body,
                                      struct palpate_error *error);

// Leads a contact along a path, from the state that it is in, and writes what it answers at each pose: the same bits as
// `palpate_contact_step` pose by pose. The sizes of `energies` and `outputs` need not be set beforehand.
// Not real-time: as long as the path; it allocates nothing.
palpate_status palpate_contact_rollout(struct palpate_contact contact,
                                       const struct palpate_path *path,
                                       const struct palpate_trace *trace,
                                       struct palpate_error *error);

// Leads `count` contacts along a path each, on up to `threads` threads (0: one for each core): the same bits as one after the other.
// `contacts`, `paths` and `traces` are arrays of `count`; no two contacts are the same, and no two traces share an array. Before anything
// runs all contacts are entered: `PALPATE_STATUS_BUSY` if one is in use, or named twice.
// Not real-time: starts threads, and returns when all have ended.
palpate_status palpate_rollout_many(const struct palpate_contact *contacts,
                                    const struct palpate_path *paths,
                                    const struct palpate_trace *traces,
                                    size_t count,
                                    size_t threads,
                                    struct palpate_error *error);

// Prepares a session of `body`: opens the device, lays out the first patch, and starts nothing yet; there is no force before
// `palpate_session_start`. `config_json` holds the settings of docs/session.md as a JSON object, e.g.
// `{"device": "simulated:touch", "seconds": 2, "safety": {"force_max_n": 1}}`; null or empty for the defaults. With a `device` of the
// caller's (not null) the setting `device` counts for nothing; its table is copied. What could not be had is told by
// `palpate_session_notes`, before the first force.
// Fails with `PALPATE_STATUS_INVALID` (the JSON), `PALPATE_STATUS_SESSION` (a setting, the device; the message says what to do).
// Not real-time: it may take seconds.
palpate_status palpate_session_prepare(struct palpate_body body,
                                       const char *config_json,
                                       const struct palpate_device *device,
                                       struct palpate_session *session,
                                       struct palpate_error *error);

// Starts the threads, and the recording if there is to be one: from now on there are forces.
// Fails with `PALPATE_STATUS_SESSION`: the device is closed then, and the handle is only good for `palpate_session_close`.
// Not real-time.
palpate_status palpate_session_start(struct palpate_session session,
                                     struct palpate_error *error);

// What could not be had (a watchdog, locked memory, a priority), and what the hand should know of this device on this body: one
// line each. Copies them to `buffer` (`capacity` bytes) with a zero at the end, and to `*needed` (may be null) the bytes that all of it
// takes; `PALPATE_STATUS_TOO_SMALL` if they did not fit. Not real-time.
palpate_status palpate_session_notes(struct palpate_session session,
                                     char *buffer,
                                     size_t capacity,
                                     size_t *needed);

// The latest period: poses, wrench, command, contact, energies, flags, times. `PALPATE_STATUS_NOTHING` before the first. The haptic
// thread does not notice who reads.
// Real-time: O(1), without a lock; it tries again while the record changes under it. `PALPATE_STATUS_BUSY` only while
// `palpate_session_start`, `_set_slip_rule`, `_change_body` or `_close` is under way.
palpate_status palpate_session_latest(struct palpate_session session,
                                      struct palpate_record *record);

// Periods of the past, as many a second as the setting `history` says, the oldest first: up to `capacity` of the newest go to
// `records`, whose sizes need not be set; `*count` says how many there are. `PALPATE_STATUS_TOO_SMALL` if there are more than `capacity`.
// Not real-time: allocates, and waits for the recorder.
palpate_status palpate_session_history(struct palpate_session session,
                                       struct palpate_record *records,
                                       size_t capacity,
                                       size_t *count);

// Statistics so far (periods, percentiles of times in ns, energies in J, the largest force in N) as JSON: copied as
// `palpate_session_notes` does. Not real-time: allocates, and waits for the recorder.
palpate_status palpate_session_summary(struct palpate_session session, char *buffer, size_t capacity, size_t *needed);

// The largest force, N, and how fast it may change, N/s (0 for the slowest slew that lets a stop end in two periods). As every
// change it is made in silence: the force goes to zero, the change is made, the force ramps up over the soft start.
// Fails with `PALPATE_STATUS_SESSION`: more than the device was opened with, 64 changes under way already, an ended session.
// It waits for no haptic thread, but may for another caller of these functions.
palpate_status palpate_session_set_force_limit(struct palpate_session session,
                                               double force_max_n,
                                               double slew_n_per_s,
                                               struct palpate_error *error);

// The largest torque, N m, and how fast it may change, N m/s; else as `palpate_session_set_force_limit`.
palpate_status palpate_session_set_torque_limit(struct palpate_session session,
                                                double torque_max_nm,
                                                double slew_nm_per_s,
                                                struct palpate_error *error);

// What multiplies the body's friction coefficients, 0 to 100; else as `palpate_session_set_force_limit`.
palpate_status palpate_session_set_friction_scale(struct palpate_session session,
                                                  double scale,
                                                  struct palpate_error *error);

// No force from the next period on, within the slew limit, until `palpate_session_resume`. It waits for no other change.
// Real-time: O(1).
palpate_status palpate_session_pause(struct palpate_session session);

// Ends a pause: the force ramps up anew. Real-time: O(1).
palpate_status palpate_session_resume(struct palpate_session session);

// Goes over to another slip rule, `PALPATE_SLIP_...`; else as `palpate_session_set_force_limit`.
palpate_status palpate_session_set_slip_rule(struct palpate_session session,
                                             uint32_t rule,
                                             struct palpate_error *error);

// Goes over to another body, through silence and the soft start; not while a recording is written. A tool that is inside the new body
// feels nothing until it has left it. Not real-time for the caller: it lays out the new body's first patch.
palpate_status palpate_session_change_body(struct palpate_session session,
                                           struct palpate_body body,
                                           struct palpate_error *error);

// Asks for the end: zero force within two periods, and a closed device. It waits for nothing; `palpate_session_close` waits.
// Real-time: O(1).
palpate_status palpate_session_stop(struct palpate_session session);

// The same with zero force before anything else, past the slew limit, by the device's own emergency stop: for a button, or when the
// program itself fails. Real-time: O(1).
palpate_status palpate_session_stop_at_once(struct palpate_session session);

// Waits until the session is over, or `timeout_s` (s) have passed; 0 does not wait. Writes 1 to `*is_over` if it is over, else 0. The
// session stays open: `palpate_session_close` tells what became of it.
palpate_status palpate_session_wait(struct palpate_session session,
                                    double timeout_s,
                                    uint32_t *is_over);

// Ends a session, if it has not ended, waits for its threads and its recording, and closes the handle. What became of it goes to
// `*outcome` (may be null); of one that was never started `end` is 0. `PALPATE_STATUS_BUSY` while another thread is in a call with it: the
// session goes on then. Not real-time.
palpate_status palpate_session_close(struct palpate_session session,
                                     struct palpate_outcome *outcome,
                                     struct palpate_error *error);

// A status in words: a string that lives as long as the library. Real-time: O(1).
const char *palpate_status_text(palpate_status status);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* PALPATE_H */
