/* A device of one's own in a session: it replays poses and logs the forces that it is commanded.
 *
 * The session gives it all that a vendor's device gets: a haptic thread, limits, a soft start, watchdogs, and zero force at the end.
 * With an argument the forces go to that file, as time,x,y,z,N,N,N. */

#include "ball.h"

#include <stdio.h>
#include <string.h>

#define POSES 2000

struct replayer {
    double positions_m[POSES][3]; /* at 1 kHz */
    double now_s;
    double forces_n[POSES][3];
    double times_s[POSES];
    double last_force_n[3]; /* a late machine can have more periods than the log has rows: this is kept of every one */
    int given;
    int logged;
    int is_open;
};

static palpate_fault replay_open(void *user, palpate_capabilities *can, char *message, size_t message_bytes)
{
    struct replayer *device = user;
    int axis;
    if (device->is_open) {
        snprintf(message, message_bytes, "it is open already; close it first");
        return PALPATE_FAULT_DISCONNECTED;
    }
    can->basis = PALPATE_BASIS_GUESSED;
    strcpy(can->name, "replay with a log");
    strcpy(can->source, "it renders nothing");
    can->max_force_n = 10.0;
    can->max_stiffness_n_per_m = 2000.0;
    for (axis = 0; axis < 3; axis++)
        can->workspace_half_extent_m[axis] = 0.1;
    can->sensed_translations = can->driven_translations = 3;
    can->usual_hz = can->most_hz = 1000.0;
    can->velocity_delay_s = -1.0; /* it reports no velocity */
    can->mass_kg = 0.1;
    can->damping_n_s_per_m = 1.0;
    can->resolution_m = 1e-6;
    device->given = device->logged = 0;
    device->is_open = 1;
    return PALPATE_FAULT_NONE;
}

/* In the haptic thread: no allocation, no lock, no file. */
static palpate_fault replay_read(void *user, double now_s, palpate_sample *sample)
{
    struct replayer *device = user;
    int k = (int)(now_s * 1000.0);
    if (k >= POSES)
        return PALPATE_FAULT_ENDED;
    k = k < 0 ? 0 : k;
    device->now_s = now_s;
    device->given = k;
    sample->sequence = (uint64_t)k + 1;
    memcpy(sample->position_m, device->positions_m[k], sizeof sample->position_m);
    return PALPATE_FAULT_NONE;
}

static palpate_fault replay_write(void *user, const palpate_command *command)
{
    struct replayer *device = user;
    memcpy(device->last_force_n, command->force_n, sizeof command->force_n);
    if (device->logged < POSES) {
        memcpy(device->forces_n[device->logged], command->force_n, sizeof command->force_n);
        device->times_s[device->logged++] = device->now_s;
    }
    return PALPATE_FAULT_NONE;
}

static void replay_close(void *user)
{
    struct replayer *device = user;
    device->is_open = 0;
}

int main(int argc, char **argv)
{
    static struct replayer replayer;
    palpate_device device = PALPATE_DEVICE_INIT;
    palpate_error error = PALPATE_ERROR_INIT;
    palpate_outcome outcome = PALPATE_OUTCOME_INIT;
    palpate_record record = PALPATE_RECORD_INIT;
    palpate_body body;
    palpate_session session;
    uint32_t is_over = 0;
    char notes[2048];
    double largest = 0.0;
    int k;

    /* Presses 5 mm in within a second and rests. The pose is the body's frame: workspace offset 0. */
    for (k = 0; k < POSES; k++)
        replayer.positions_m[k][2] = BALL_RADIUS_M + 3e-3 - 8e-3 * (k < POSES / 2 ? k / (POSES / 2.0) : 1.0);
    device.user = &replayer;
    device.open = replay_open;
    device.read = replay_read;
    device.write = replay_write;
    device.close = replay_close;

    if (make_ball(&body, &error)) {
        fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    /* Nobody holds it, and the machine may be busy: a late period is no reason to end. It rests for longer than a hand does. */
    if (palpate_session_prepare(body,
                                "{\"workspace\": {\"offset_m\": [0, 0, 0]}, \"safety\": {\"force_max_n\": 2, \"silence_s\": 5, "
                                "\"stale_s\": 5}, \"patience\": {\"late_s\": 5, \"pose_s\": 5, \"finder_s\": 10}, "
                                "\"real_time\": {\"priority\": 0, \"core\": -1, \"lock_memory\": false, \"spin_s\": 0}}",
                                &device, &session, &error)) {
        fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    if (palpate_session_notes(session, notes, sizeof notes, NULL) == PALPATE_STATUS_OK && notes[0])
        printf("to know before the first force: %s\n", notes);
    if (palpate_session_start(session, &error)) {
        fprintf(stderr, "%s\n", error.message);
        palpate_session_close(session, NULL, NULL);
        return 1;
    }
    while (!is_over) {
        palpate_session_wait(session, 0.5, &is_over);
        if (palpate_session_latest(session, &record) == PALPATE_STATUS_OK)
            printf("%.2f s: depth %.2f mm, commanded %.3f N\n", record.time_s, 1e3 * record.delta_z_m,
                   record.command_force_n[2]);
    }
    if (palpate_session_close(session, &outcome, &error)) {
        fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    printf("%s; %llu periods, at most %.3f N\n", outcome.message, (unsigned long long)outcome.periods, outcome.force_max_n);
    for (k = 0; k < replayer.logged; k++)
        largest = replayer.forces_n[k][2] > largest ? replayer.forces_n[k][2] : largest;
    if (argc > 1) {
        FILE *file = fopen(argv[1], "w");
        if (!file)
            return 1;
        fprintf(file, "time_s,force_x_n,force_y_n,force_z_n\n");
        for (k = 0; k < replayer.logged; k++)
            fprintf(file, "%.6f,%.9g,%.9g,%.9g\n", replayer.times_s[k], replayer.forces_n[k][0], replayer.forces_n[k][1],
                    replayer.forces_n[k][2]);
        fclose(file);
    }
    palpate_body_close(body);
    /* It ended since its poses did, it is closed, it pushed back within the limit, and the last that it was told is zero. */
    return outcome.end == PALPATE_END_ENDED && outcome.is_well && !replayer.is_open && largest > 0.5 && largest <= 2.0 &&
                   replayer.last_force_n[2] == 0.0
               ? 0
               : 1;
}
