/* Times a step through the C interface: the path of same_path.c, over and over. Arguments: the body's file, the path, repetitions. Prints
 * nanoseconds a step, the least of the repetitions. */

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
    double least = 1e300, sum = 0.0;
    size_t n, k;
    int repetition;

    if (!file || palpate_body_open(argv[1], &body, &error) || palpate_contact_create(body, NULL, &start, &error) ||
        palpate_contact_snapshot(start, &contact))
        return 1;
    n = fread(rows, sizeof rows[0], 100000, file);
    fclose(file);
    for (repetition = 0; repetition < atoi(argv[3]); repetition++) {
        palpate_tool_state tool = PALPATE_TOOL_STATE_INIT;
        palpate_output output = PALPATE_OUTPUT_INIT;
        struct timespec begun, ended;
        double ns;
        palpate_contact_restore(contact, start);
        clock_gettime(CLOCK_MONOTONIC, &begun);
        for (k = 0; k < n; k++) {
            memcpy(tool.position_m, rows[k] + 1, sizeof tool.position_m);
            if (palpate_contact_step(contact, &tool, 1e-3, &output))
                return 1;
            sum += output.force_n[2];
        }
        clock_gettime(CLOCK_MONOTONIC, &ended);
        ns = 1e9 * (double)(ended.tv_sec - begun.tv_sec) + (double)(ended.tv_nsec - begun.tv_nsec);
        least = ns < least ? ns : least;
    }
    printf("%.2f %.17g\n", least / (double)n, sum);
    return 0;
}
