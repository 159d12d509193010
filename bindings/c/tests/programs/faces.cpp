// All of palpate.hpp, used and misused; also without exceptions.

#include "palpate.hpp"

#include "../../examples/ball.h"

#include <cstdio>
#include <cstdlib>
#if __cplusplus >= 202002L
#include <span>
#endif

namespace {

int wrong = 0;

void expect(bool holds, int line) {
    if (holds) return;
    std::fprintf(stderr, "line %d\n", line);
    ++wrong;
}
#define EXPECT(...) expect((__VA_ARGS__), __LINE__)

using palpate::Status;

// Presses 4 mm in within 0.2 s, and has no more poses after 0.4 s.
class Presser final : public palpate::Device {
public:
    palpate_fault open(palpate_capabilities &can, palpate::Span<char> message) noexcept override {
        if (refuses) {
            std::snprintf(message.data(), message.size(), "not today");
            return PALPATE_FAULT_NOT_OPEN;
        }
        can.basis = PALPATE_BASIS_GUESSED;
        std::snprintf(can.name, sizeof can.name, "presser");
        can.max_force_n = 5;
        can.max_stiffness_n_per_m = 2000;
        can.sensed_translations = can.driven_translations = 3;
        for (double &x : can.workspace_half_extent_m) x = 0.1;
        can.usual_hz = can.most_hz = 1000;
        can.velocity_delay_s = -1;
        can.mass_kg = 0.1;
        can.damping_n_s_per_m = 1;
        ++opened;
        return PALPATE_FAULT_NONE;
    }
    palpate_fault read(double now_s, palpate_sample &sample) noexcept override {
        if (now_s > 0.4) return PALPATE_FAULT_ENDED;
        sample.sequence = ++periods;
        sample.position_m[2] = BALL_RADIUS_M + 1e-3 - 5e-3 * (now_s < 0.2 ? now_s / 0.2 : 1.0);
        return PALPATE_FAULT_NONE;
    }
    palpate_fault write(const palpate_command &command) noexcept override {
        largest = command.force_n[2] > largest ? command.force_n[2] : largest;
        return PALPATE_FAULT_NONE;
    }
    void close() noexcept override { ++closed; }

    bool refuses = false;
    std::uint64_t periods = 0;
    int opened = 0, closed = 0;
    double largest = 0;
};

const char *const quiet = R"({"workspace": {"offset_m": [0, 0, 0]}, "safety": {"soft_start_s": 0.05, "silence_s": 5},
    "patience": {"late_s": 10, "finder_s": 60},
    "real_time": {"priority": 0, "core": -1, "lock_memory": false, "spin_s": 0}})";

void without_exceptions(const palpate::Body &ball) {
    palpate::Body body;
    palpate::Message message;
    EXPECT(palpate::Body::try_open("no such.body", body, &message) == Status::body && !body);
    EXPECT(std::strstr(message.words(), "no such.body") != nullptr);
    EXPECT(palpate::Body::try_open("no such.body", body) == Status::body);
    std::uint8_t noise[3] = {1, 2, 3};
    EXPECT(palpate::Body::try_from_memory(noise, body, &message) == Status::body);
    EXPECT(palpate::Body::try_from_arrays(palpate::BodyArrays(), body, &message) == Status::body);
    auto progress = [](std::uint64_t, std::uint64_t, const char *) { return true; };
    EXPECT(palpate::Body::try_from_spec("no such.toml", nullptr, 1, progress, body, &message) != Status::ok);
    EXPECT(ball.try_save("no such folder/x.body", &message) == Status::body);
    palpate::LoopDevice device;
    EXPECT(palpate::LoopDevice::try_of("wand", 1000, device, &message) == Status::invalid);
    EXPECT(palpate::LoopDevice::try_of("touch", 1000, device) == Status::ok && device.damping_n_s_per_m > 0);
    palpate::CertifyOptions certify_options;
    palpate::Certificate certificate;
    certify_options.device = &device;
    std::uint64_t elements = 0;
    auto few = [&](std::uint64_t done, std::uint64_t) { return (elements = done) < 3; };
    EXPECT(ball.try_certify(certify_options, few, certificate, &message) == Status::cancelled && elements >= 3);
    palpate::BodyInfo info;
    EXPECT(ball.try_inspect(info) == Status::ok && info.elements == BALL_TRIANGLES);
    EXPECT(body.try_inspect(info) == Status::closed);
    std::vector<double> positions(3 * info.nodes);
    std::vector<std::uint32_t> triangles(3 * info.elements);
    EXPECT(ball.try_surface(positions, triangles) == Status::ok);
    positions.resize(3);
    EXPECT(ball.try_surface(positions, triangles) == Status::too_small);

    palpate::Contact contact, other;
    palpate::ContactOptions options;
    options.slip_rule = 17;
    EXPECT(palpate::Contact::try_create(ball, options, contact, &message) == Status::invalid && !contact);
    options.slip_rule = PALPATE_SLIP_EXACT;
    EXPECT(palpate::Contact::try_create(ball, options, contact) == Status::ok && contact);
    palpate::Output output;
    EXPECT(other.try_step(palpate::ToolState(), 1e-3, output) == Status::closed);
    EXPECT(contact.try_step(palpate::ToolState({0, 0, 0.031}), 1e-3, output) == Status::ok);
    EXPECT(contact.try_step(palpate::ToolState({0, 0, 0.028}, {1, 0, 0, 0}), 1e-3, output) == Status::ok);
    EXPECT(output.has(PALPATE_FLAG_IN_CONTACT) && output.force()[2] > 0.1 && output.torque()[0] == 0);
    EXPECT(contact.try_snapshot(other) == Status::ok);
    EXPECT(contact.try_forget() == Status::ok && contact.try_restore(other) == Status::ok);
    EXPECT(contact.try_set_friction_scale(-1) == Status::invalid && contact.try_set_friction_scale(0.5) == Status::ok);
    EXPECT(contact.try_set_tank(false) == Status::ok && contact.try_set_slip_rule(PALPATE_SLIP_PAPER) == Status::ok);
    palpate::Ledger ledger;
    palpate::Counters counters;
    EXPECT(contact.try_ledger(ledger) == Status::ok && ledger.work_j > 0);
    EXPECT(contact.try_counters(counters) == Status::ok && counters.steps == 2);
    // Moved from, a contact is of nothing.
    palpate::Contact taken = std::move(contact);
    EXPECT(!contact && taken && contact.try_forget() == Status::closed);
    // A path, and arrays that are too short for it.
    const double times[2] = {0, 1e-3}, places[6] = {0, 0, 0.028, 0, 0, 0.027};
    double forces[6];
    palpate::Path path;
    palpate::Trace trace;
    path.times_s = times;
    path.positions_m = palpate::Span<const double>(places, 5);
    trace.forces_n = forces;
    EXPECT(taken.try_rollout(path, trace) == Status::too_small);
    path.positions_m = places;
    trace.forces_n = palpate::Span<double>(forces, 5);
    EXPECT(taken.try_rollout(path, trace) == Status::too_small);
    trace.forces_n = forces;
    EXPECT(taken.try_rollout(path, trace, &message) == Status::ok && forces[5] > forces[2]);
#if __cplusplus >= 202002L
    path.positions_m = std::span<const double>(places);
    EXPECT(taken.try_rollout(path, trace) == Status::ok);
#endif

    Presser presser;
    palpate::Session session;
    presser.refuses = true;
    EXPECT(palpate::Session::try_prepare(ball, quiet, &presser, session, &message) == Status::session && !session);
    EXPECT(std::strstr(message.words(), "not today") != nullptr && presser.closed == 0);
    presser.refuses = false;
    EXPECT(palpate::Session::try_prepare(ball, quiet, &presser, session, &message) == Status::ok);
    palpate::Record record;
    EXPECT(session.try_latest(record) == Status::nothing);
    EXPECT(session.try_start(&message) == Status::ok);
    EXPECT(session.try_set_force_limit(1e9, 0, &message) == Status::session);
    EXPECT(session.wait(60) && session.try_latest(record) == Status::ok && record.number > 0);
    palpate::Outcome outcome;
    EXPECT(session.try_close(outcome) == Status::ok && outcome.end == PALPATE_END_ENDED && !session);
    EXPECT(presser.opened == 1 && presser.closed == 1 && presser.largest > 0.2);
    // Destroyed while it runs.
    {
        palpate::Session running;
        EXPECT(palpate::Session::try_prepare(ball, quiet, &presser, running) == Status::ok);
        EXPECT(running.try_start() == Status::ok && running.pause() == Status::ok && running.resume() == Status::ok);
        EXPECT(running.try_set_friction_scale(0.5) == Status::ok && running.try_change_body(ball) == Status::ok);
    }
    EXPECT(presser.opened == 2 && presser.closed == 2);
}

#ifndef PALPATE_NO_EXCEPTIONS
template <class Call> Status thrown(Call call) {
    try {
        call();
    } catch (const palpate::Error &error) {
        EXPECT(error.what()[0] != '\0');
        return error.status();
    }
    return Status::ok;
}

void with_exceptions(const palpate::Body &ball) {
    EXPECT(thrown([] { palpate::Body::open("no such.body"); }) == Status::body);
    EXPECT(thrown([] { palpate::Body::from_spec("no such.toml"); }) != Status::ok);
    EXPECT(thrown([] { palpate::Body().inspect(); }) == Status::closed);
    EXPECT(thrown([] { palpate::Contact contact{palpate::Body()}; }) == Status::closed);
    EXPECT(thrown([&] { palpate::Session session(ball, "{"); }) == Status::invalid);
    EXPECT(thrown([&] { ball.save("no such folder/x.body"); }) == Status::body);
    std::vector<palpate::Contact> two(2);
    EXPECT(thrown([&] { palpate::rollout_many(two, {}, {}); }) == Status::invalid);

    palpate::Contact contact(ball);
    contact.step(palpate::ToolState({0, 0, 0.031}), 1e-3);
    const palpate::Contact before = contact.snapshot();
    const palpate::Output pressed = contact.step(palpate::ToolState({0, 0, 0.028}), 1e-3);
    contact.restore(before);
    EXPECT(contact.counters().steps == 1 && contact.ledger().work_j == 0);
    const std::vector<double> times = {0}, places = {0, 0, 0.028};
    palpate::Path path;
    path.times_s = times;
    path.positions_m = places;
    EXPECT(contact.rollout(path) == std::vector<double>(pressed.force_n, pressed.force_n + 3));

    Presser presser;
    palpate::Session session(ball, quiet, &presser);
    session.notes();
    session.start();
    EXPECT(session.stop() == Status::ok && session.wait(60));
    EXPECT(session.close().end == PALPATE_END_ASKED);
}
#endif

} // namespace

int main() {
    palpate_body handle{0};
    if (make_ball(&handle, nullptr) != PALPATE_STATUS_OK) return 1;
    const palpate::Body ball(handle);
    without_exceptions(ball);
#ifndef PALPATE_NO_EXCEPTIONS
    with_exceptions(ball);
#endif
    std::printf("%d wrong\n", wrong);
    return wrong == 0 ? 0 : 1;
}
