// The same in C++: a loop of one's own, a snapshot to look ahead from, and many contacts on all cores.

#include "palpate.hpp"

#include "ball.h"

#include <cstdio>
#include <vector>

namespace {

palpate::Body ball() {
    palpate::Message message;
    palpate_body handle; // ball.h speaks C
    if (make_ball(&handle, &message) != PALPATE_STATUS_OK) throw palpate::Error(palpate::Status::body, message.words());
    return palpate::Body(handle);
}

// From 2 mm above the ball to 5 mm deep in half a second, then 15 mm along in one.
palpate::Vector tool_at(double t) {
    const double down = t < 0.5 ? t / 0.5 : 1.0, along = t < 0.5 ? 0.0 : t - 0.5;
    return {15e-3 * along, 0.0, BALL_RADIUS_M + 2e-3 - 7e-3 * down};
}

} // namespace

int main() {
    try {
        const palpate::Body body = ball();
        const palpate::BodyInfo info = body.inspect();
        std::printf("%llu triangles, up to %.0f N/m\n", static_cast<unsigned long long>(info.elements),
                    info.stiffness_max_n_per_m);

        palpate::Contact contact(body);
        palpate::Output output;
        for (int period = 0; period < 1000; ++period) {
            // In a real-time loop take the call that throws nothing.
            if (contact.try_step(palpate::ToolState(tool_at(period * 1e-3)), 1e-3, output) != palpate::Status::ok) return 1;
        }
        std::printf("after 1 s: %.3f %.3f %.3f N\n", output.force_n[0], output.force_n[1], output.force_n[2]);

        // What would the next half second bring? Ask a snapshot; the contact stays where it is.
        palpate::Contact ahead = contact.snapshot();
        palpate::Output later;
        for (int period = 1000; period < 1500; ++period) later = ahead.step(palpate::ToolState(tool_at(period * 1e-3)), 1e-3);
        std::printf("half a second on: %.3f %.3f %.3f N\n", later.force_n[0], later.force_n[1], later.force_n[2]);

        // A hundred paths, each a little aside of the other, on all cores.
        constexpr std::size_t many = 100, poses = 1000;
        std::vector<palpate::Contact> contacts;
        std::vector<double> times(poses), positions(many * poses * 3), forces(many * poses * 3);
        std::vector<palpate::Path> paths(many);
        std::vector<palpate::Trace> traces(many);
        for (std::size_t k = 0; k < poses; ++k) times[k] = 1e-3 * static_cast<double>(k);
        for (std::size_t c = 0; c < many; ++c) {
            contacts.emplace_back(body);
            double *p = &positions[3 * poses * c];
            for (std::size_t k = 0; k < poses; ++k) {
                const palpate::Vector at = tool_at(times[k]);
                p[3 * k] = at[0];
                p[3 * k + 1] = at[1] + 1e-5 * static_cast<double>(c);
                p[3 * k + 2] = at[2];
            }
            paths[c].times_s = times;
            paths[c].positions_m = palpate::Span<const double>(p, 3 * poses);
            traces[c].forces_n = palpate::Span<double>(&forces[3 * poses * c], 3 * poses);
        }
        palpate::rollout_many(contacts, paths, traces);
        const double *last = &forces[3 * (poses - 1)];
        std::printf("%zu paths of %zu poses; the first ends at %.3f N\n", many, poses, last[2]);
        // The first is the loop above, to the bit.
        return last[0] == output.force_n[0] && last[2] == output.force_n[2] ? 0 : 1;
    } catch (const palpate::Error &error) {
        std::fprintf(stderr, "%s\n", error.what());
        return 1;
    }
}
