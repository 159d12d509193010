// As same_path.c, in C++.

#include "palpate.hpp"

#include <cinttypes>
#include <cstdio>
#include <cstring>

static void print_bits(const char *way, const double *force_n, const double *torque_nm) {
    std::uint64_t bits[6];
    std::memcpy(bits, force_n, 24);
    std::memcpy(bits + 3, torque_nm, 24);
    std::printf("%s %016" PRIx64 " %016" PRIx64 " %016" PRIx64 " %016" PRIx64 " %016" PRIx64 " %016" PRIx64 "\n", way, bits[0],
                bits[1], bits[2], bits[3], bits[4], bits[5]);
}

int main(int argc, char **argv) {
    if (argc != 3) return 1;
    std::FILE *file = std::fopen(argv[2], "rb");
    if (!file) return 1;
    std::vector<double> times, positions, orientations;
    double row[7];
    while (std::fread(row, sizeof row, 1, file) == 1) {
        times.push_back(row[0]);
        positions.insert(positions.end(), row + 1, row + 4);
        orientations.insert(orientations.end(), {1.0, 0.0, 0.0, 0.0});
    }
    std::fclose(file);
    const std::size_t n = times.size();

    const palpate::Body body = palpate::Body::open(argv[1]);
    palpate::Contact contact(body);
    for (std::size_t k = 0; k < n; ++k) {
        const double *p = &positions[3 * k], *q = &orientations[4 * k];
        const palpate::ToolState tool({p[0], p[1], p[2]}, {q[0], q[1], q[2], q[3]});
        const palpate::Output output = contact.step(tool, k ? times[k] - times[k - 1] : 0.0);
        print_bits("step", output.force_n, output.torque_nm);
    }

    palpate::Path path;
    path.times_s = times;
    path.positions_m = positions;
    path.orientations = orientations;
    std::vector<palpate::Contact> contacts;
    std::vector<std::vector<double>> forces(4, std::vector<double>(3 * n)), torques = forces;
    std::vector<palpate::Path> paths(3, path);
    std::vector<palpate::Trace> traces(4);
    for (std::size_t c = 0; c < 4; ++c) {
        traces[c].forces_n = forces[c];
        traces[c].torques_nm = torques[c];
        if (c < 3) contacts.emplace_back(body);
    }
    palpate::Contact one(body);
    if (one.try_rollout(path, traces[3]) != palpate::Status::ok) return 1;
    for (std::size_t k = 0; k < n; ++k) print_bits("rollout", &forces[3][3 * k], &torques[3][3 * k]);
    palpate::rollout_many(contacts, paths, palpate::Span<const palpate::Trace>(traces.data(), 3));
    for (std::size_t k = 0; k < n; ++k) print_bits("many", &forces[2][3 * k], &torques[2][3 * k]);
    return 0;
}
