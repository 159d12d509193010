/* A loop of one's own at 1 kHz: a tool presses into a ball, drags over it, and leaves it.
 *
 * Here the tool's way is a formula and the force is printed; in a simulator the pose comes from a device and the force goes to it. */

#define _POSIX_C_SOURCE 200809L

#include "ball.h"

#include <stdio.h>
#include <time.h>

#define RATE_HZ 1000
#define SECONDS 2

/* Where the tool is at a time, m: from 2 mm above the ball down to 5 mm deep, along by 15 mm, and up again. */
static void tool_at(double t, double at[3])
{
    const double down = t < 0.5 ? t / 0.5 : (t < 1.5 ? 1.0 : (2.0 - t) / 0.5);
    const double along = t < 0.5 ? 0.0 : (t < 1.5 ? t - 0.5 : 1.0);
    at[0] = 15e-3 * along;
    at[1] = 0.0;
    at[2] = BALL_RADIUS_M + 2e-3 - 7e-3 * down;
}

static int failed(const char *what, palpate_status status, const palpate_error *error)
{
    fprintf(stderr, "%s: %s\n", what, error && error->message[0] ? error->message : palpate_status_text(status));
    return 1;
}

int main(void)
{
    palpate_error error = PALPATE_ERROR_INIT;
    palpate_output output = PALPATE_OUTPUT_INIT;
    palpate_tool_state tool = PALPATE_TOOL_STATE_INIT;
    palpate_ledger ledger = PALPATE_LEDGER_INIT;
    palpate_body body;
    palpate_contact contact;
    palpate_status status;
    struct timespec due;
    int period;

    /* Before the loop, where time does not matter. */
    if ((status = palpate_check_abi(PALPATE_ABI_VERSION)) != PALPATE_STATUS_OK)
        return failed("the library", status, NULL);
    if ((status = make_ball(&body, &error)) != PALPATE_STATUS_OK)
        return failed("the body", status, &error);
    if ((status = palpate_contact_create(body, NULL, &contact, &error)) != PALPATE_STATUS_OK)
        return failed("the contact", status, &error);
    palpate_body_close(body); /* The contact keeps what it needs. */

    clock_gettime(CLOCK_MONOTONIC, &due);
    for (period = 0; period < RATE_HZ * SECONDS; period++) {
        tool_at((double)period / RATE_HZ, tool.position_m);
        /* The one call of the loop: it never waits, allocates or fails for a pose. */
        status = palpate_contact_step(contact, &tool, 1.0 / RATE_HZ, &output);
        if (status != PALPATE_STATUS_OK)
            return failed("the step", status, NULL);
        if (period % 100 == 0)
            printf("%4d ms: %7.3f %7.3f %7.3f N%s%s\n", period, output.force_n[0], output.force_n[1], output.force_n[2],
                   output.flags & PALPATE_FLAG_IN_CONTACT ? ", in contact" : "",
                   output.flags & PALPATE_FLAG_SLIPPING ? ", slipping" : "");
        due.tv_nsec += 1000000000 / RATE_HZ;
        if (due.tv_nsec >= 1000000000) {
            due.tv_nsec -= 1000000000;
            due.tv_sec++;
        }
        clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL);
    }

    palpate_contact_ledger(contact, &ledger);
    printf("work %.3f mJ, dissipated %.3f mJ, generated %.3f mJ\n", 1e3 * ledger.work_j, 1e3 * ledger.dissipated_j,
           1e3 * ledger.generated_j);
    palpate_contact_close(contact);
    return ledger.work_j > 0.0 ? 0 : 1;
}
