/* Steps along a path on a body, three ways, and prints every force and torque in bits: pose by pose, as a rollout, and as one of several
 * on all cores. Arguments: the body's file, and a file of doubles, time x y z w x y z each. */

#include "palpate.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define COPIES 5

static void print_bits(const char *way, const double *force_n, const double *torque_nm)
{
    uint64_t bits[6];
    memcpy(bits, force_n, 3 * sizeof(double));
    memcpy(bits + 3, torque_nm, 3 * sizeof(double));
    printf("%s %016llx %016llx %016llx %016llx %016llx %016llx\n", way, (unsigned long long)bits[0], (unsigned long long)bits[1],
           (unsigned long long)bits[2], (unsigned long long)bits[3], (unsigned long long)bits[4], (unsigned long long)bits[5]);
}

int main(int argc, char **argv)
{
    palpate_error error = PALPATE_ERROR_INIT;
    palpate_body body;
    palpate_contact contact, many[COPIES];
    palpate_path paths[COPIES], path = PALPATE_PATH_INIT;
    palpate_trace traces[COPIES];
    FILE *file = argc == 3 ? fopen(argv[2], "rb") : NULL;
    static double rows[100000][7];
    double *times_s, *positions_m, *orientations, *wrenches[COPIES];
    size_t n, k, copy;

    if (!file || palpate_body_open(argv[1], &body, &error)) {
        fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    n = fread(rows, sizeof rows[0], 100000, file);
    fclose(file);
    times_s = malloc(8 * n * sizeof(double));
    positions_m = times_s + n;
    orientations = positions_m + 3 * n;
    for (k = 0; k < n; k++) {
        times_s[k] = rows[k][0];
        memcpy(positions_m + 3 * k, rows[k] + 1, 3 * sizeof(double));
        orientations[4 * k] = 1.0;
        orientations[4 * k + 1] = orientations[4 * k + 2] = orientations[4 * k + 3] = 0.0;
    }

    if (palpate_contact_create(body, NULL, &contact, &error))
        return 1;
    for (k = 0; k < n; k++) {
        palpate_tool_state tool = PALPATE_TOOL_STATE_INIT;
        palpate_output output = PALPATE_OUTPUT_INIT;
        memcpy(tool.position_m, positions_m + 3 * k, sizeof tool.position_m);
        memcpy(tool.orientation, orientations + 4 * k, sizeof tool.orientation);
        if (palpate_contact_step(contact, &tool, k ? times_s[k] - times_s[k - 1] : 0.0, &output))
            return 1;
        print_bits("step", output.force_n, output.torque_nm);
    }
    palpate_contact_close(contact);

    path.count = n;
    path.times_s = times_s;
    path.positions_m = positions_m;
    path.orientations = orientations;
    for (copy = 0; copy < COPIES; copy++) {
        const palpate_trace trace = PALPATE_TRACE_INIT;
        if (palpate_contact_create(body, NULL, &many[copy], &error))
            return 1;
        wrenches[copy] = calloc(6 * n, sizeof(double));
        paths[copy] = path;
        traces[copy] = trace;
        traces[copy].forces_n = wrenches[copy];
        traces[copy].torques_nm = wrenches[copy] + 3 * n;
    }
    if (palpate_contact_rollout(many[0], &paths[0], &traces[0], &error))
        return 1;
    for (k = 0; k < n; k++)
        print_bits("rollout", wrenches[0] + 3 * k, wrenches[0] + 3 * n + 3 * k);
    /* From the first pose anew, as the others. */
    palpate_contact_close(many[0]);
    if (palpate_contact_create(body, NULL, &many[0], &error) ||
        palpate_rollout_many(many, paths, traces, COPIES, 0, &error))
        return 1;
    for (k = 0; k < n; k++)
        print_bits("many", wrenches[COPIES - 1] + 3 * k, wrenches[COPIES - 1] + 3 * n + 3 * k);
    for (copy = 0; copy < COPIES; copy++) {
        if (memcmp(wrenches[copy], wrenches[0], 6 * n * sizeof(double)))
            return 1;
        palpate_contact_close(many[copy]);
    }
    for (copy = 0; copy < COPIES; copy++)
        free(wrenches[copy]);
    free(times_s);
    palpate_body_close(body);
    return 0;
}
