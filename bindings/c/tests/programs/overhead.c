/* Times a step through the C interface, and a step of a rollout, which is Rust's loop behind one call: along a path as same_path.c reads
 * it. Arguments: the body's file, the path, repetitions. Prints the least nanoseconds a step of both, of processor time. */

#define _POSIX_C_SOURCE 200809L

#include "palpate.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

int main(int argc, char **argv)
{
    palpate_error error = PALPATE_ERROR_INIT;
    palpate_body body;
    palpate_contact start, contact;
    static double rows[100000][7];
    FILE *file = argc == 4 ? fopen(argv[2], "rb") : NULL;
    static double times_s[100000], positions_m[300000], forces_n[300000];
    palpate_path way = PALPATE_PATH_INIT;
    palpate_trace trace = PALPATE_TRACE_INIT;
    double least = 1e300, least_of_rollout = 1e300, sum = 0.0;
    size_t n, k;
    int repetition;

    if (!file || palpate_body_open(argv[1], &body, &error) || palpate_contact_create(body, NULL, &start, &error) ||
        palpate_contact_snapshot(start, &contact))
        return 1;
    n = fread(rows, sizeof rows[0], 100000, file);
    fclose(file);
    for (k = 0; k < n; k++) {
        times_s[k] = 1e-3 * (double)k;
        memcpy(positions_m + 3 * k, rows[k] + 1, 3 * sizeof(double));
    }
    way.count = n;
    way.times_s = times_s;
    way.positions_m = positions_m;
    trace.forces_n = forces_n;
    for (repetition = 0; repetition < atoi(argv[3]); repetition++) {
        palpate_tool_state tool = PALPATE_TOOL_STATE_INIT;
        palpate_output output = PALPATE_OUTPUT_INIT;
        struct timespec begun, ended;
        double ns;
        palpate_contact_restore(contact, start);
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begun);
        for (k = 0; k < n; k++) {
            memcpy(tool.position_m, rows[k] + 1, sizeof tool.position_m);
            if (palpate_contact_step(contact, &tool, 1e-3, &output))
                return 1;
            sum += output.force_n[2];
        }
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &ended);
        ns = 1e9 * (double)(ended.tv_sec - begun.tv_sec) + (double)(ended.tv_nsec - begun.tv_nsec);
        least = ns < least ? ns : least;
        palpate_contact_restore(contact, start);
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &begun);
        if (palpate_contact_rollout(contact, &way, &trace, NULL))
            return 1;
        clock_gettime(CLOCK_THREAD_CPUTIME_ID, &ended);
        ns = 1e9 * (double)(ended.tv_sec - begun.tv_sec) + (double)(ended.tv_nsec - begun.tv_nsec);
        least_of_rollout = ns < least_of_rollout ? ns : least_of_rollout;
        sum -= forces_n[3 * n - 1];
    }
    printf("%.2f %.2f %.17g\n", least / (double)n, least_of_rollout / (double)n, sum);
    return 0;
}
