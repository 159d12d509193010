/* Everything that must not be done, and the status that each gives. Run under address and undefined-behaviour sanitizers it also shows
 * that none of it reads or writes what it should not. With the argument `threads` it is only two threads on one contact, and on thousands: a thread
 * sanitizer sees the C side, and not what the library's own threads agree upon. */

#define _POSIX_C_SOURCE 200809L

#include "../../examples/ball.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int wrong = 0;

#define EXPECT(expected, call)                                                                                         \
    do {                                                                                                               \
        const palpate_status got = (call);                                                                             \
        if (got != (expected)) {                                                                                       \
            fprintf(stderr, "line %d: %s gave %d (%s)\n", __LINE__, #call, (int)got, palpate_status_text(got));        \
            wrong++;                                                                                                   \
        }                                                                                                              \
    } while (0)
#define OK(call) EXPECT(PALPATE_STATUS_OK, call)
#define NULL_(call) EXPECT(PALPATE_STATUS_NULL, call)
#define SIZE(call) EXPECT(PALPATE_STATUS_WRONG_SIZE, call)
#define VERSION(call) EXPECT(PALPATE_STATUS_WRONG_VERSION, call)
#define CLOSED(call) EXPECT(PALPATE_STATUS_CLOSED, call)
#define INVALID(call) EXPECT(PALPATE_STATUS_INVALID, call)
#define SAYS(words)                                                                                                    \
    do {                                                                                                               \
        if (!strstr(error.message, words)) {                                                                           \
            fprintf(stderr, "line %d: \"%s\" is not in: %s\n", __LINE__, words, error.message);                        \
            wrong++;                                                                                                   \
        }                                                                                                              \
    } while (0)

static palpate_error error = PALPATE_ERROR_INIT;

static void certificates(palpate_body ball)
{
    palpate_certify_options options = PALPATE_CERTIFY_OPTIONS_INIT;
    palpate_loop_device device = PALPATE_LOOP_DEVICE_INIT;
    palpate_certificate certificate = PALPATE_CERTIFICATE_INIT;

    NULL_(palpate_loop_device_of(NULL, 1000, &device, &error));
    NULL_(palpate_loop_device_of("touch", 1000, NULL, &error));
    INVALID(palpate_loop_device_of("wand", 1000, &device, &error));
    SAYS("falcon");
    INVALID(palpate_loop_device_of("touch", 0, &device, &error));
    OK(palpate_loop_device_of("touch", 1000, &device, &error));
    NULL_(palpate_body_certify(ball, &options, NULL, NULL, NULL, &error));
    options.device = &device;
    device.struct_size--;
    SIZE(palpate_body_certify(ball, &options, NULL, NULL, &certificate, &error));
    device.struct_size++;
    options.struct_size--;
    SIZE(palpate_body_certify(ball, &options, NULL, NULL, &certificate, &error));
    options.struct_size++;
    certificate.struct_size++;
    SIZE(palpate_body_certify(ball, &options, NULL, NULL, &certificate, &error));
    certificate.struct_size--;
    options.step_m = -1;
    INVALID(palpate_body_certify(ball, &options, NULL, NULL, &certificate, &error));
    SAYS("step_m");
    CLOSED(palpate_body_certify((palpate_body){12345}, NULL, NULL, NULL, &certificate, &error));
    /* Little effort proves little, but counts every element. */
    options.step_m = 1e-4;
    options.evaluations = 1;
    options.threads = 2;
    options.slip_rule = PALPATE_SLIP_PAPER;
    OK(palpate_body_certify(ball, &options, NULL, NULL, &certificate, &error));
    if (certificate.passive_proved_elements + certificate.passive_failing_elements +
            certificate.passive_undecided_elements != certificate.elements) {
        fprintf(stderr, "elements are missing\n");
        wrong++;
    }
}

static void bodies(palpate_body ball)
{
    palpate_body_info info = PALPATE_BODY_INFO_INIT;
    palpate_body_arrays arrays = PALPATE_BODY_ARRAYS_INIT;
    palpate_body other = {0};
    uint8_t noise[64];
    double depths[1];
    size_t count;
    double *positions;
    uint32_t *triangles;

    NULL_(palpate_body_open(NULL, &other, &error));
    NULL_(palpate_body_open("x.body", NULL, &error));
    EXPECT(PALPATE_STATUS_BODY, palpate_body_open("there is no such.body", &other, &error));
    SAYS("there is no such.body");
    EXPECT(PALPATE_STATUS_BODY, palpate_body_open("there is no such.body", &other, NULL));
    error.struct_size = 8;
    SIZE(palpate_body_open("x.body", &other, &error));
    error.struct_size = sizeof error;
    INVALID(palpate_body_open("\xff\xfe.body", &other, &error));
    NULL_(palpate_body_from_memory(NULL, 10, &other, &error));
    memset(noise, 7, sizeof noise);
    EXPECT(PALPATE_STATUS_BODY, palpate_body_from_memory(noise, sizeof noise, &other, &error));
    EXPECT(PALPATE_STATUS_BODY, palpate_body_from_memory(NULL, 0, &other, &error));
    INVALID(palpate_body_from_memory(noise, SIZE_MAX, &other, &error));
    NULL_(palpate_body_save(ball, NULL, &error));
    EXPECT(PALPATE_STATUS_BODY, palpate_body_save(ball, "no such folder/x.body", &error));
    NULL_(palpate_body_inspect(ball, NULL));
    info.struct_size--;
    SIZE(palpate_body_inspect(ball, &info));
    info.struct_size++;
    OK(palpate_body_inspect(ball, &info));
    certificates(ball);
    NULL_(palpate_body_stiffness(ball, depths, NULL, 1, NULL));
    EXPECT(PALPATE_STATUS_TOO_SMALL, palpate_body_stiffness(ball, depths, NULL, 1, &count));
    /* Exactly as long as they must be: one more would be seen. */
    positions = malloc(info.nodes * 3 * sizeof(double));
    triangles = malloc(info.elements * 3 * sizeof(uint32_t));
    OK(palpate_body_surface(ball, positions, info.nodes, triangles, info.elements));
    EXPECT(PALPATE_STATUS_TOO_SMALL, palpate_body_surface(ball, positions, info.nodes - 1, triangles, info.elements));
    EXPECT(PALPATE_STATUS_TOO_SMALL, palpate_body_surface(ball, NULL, 0, triangles, info.elements - 1));
    free(positions);
    free(triangles);

    NULL_(palpate_body_from_arrays(NULL, &other, &error));
    NULL_(palpate_body_from_arrays(&arrays, NULL, &error));
    EXPECT(PALPATE_STATUS_BODY, palpate_body_from_arrays(&arrays, &other, &error));
    arrays.abi_version = 0;
    VERSION(palpate_body_from_arrays(&arrays, &other, &error));
    arrays.abi_version = PALPATE_ABI_VERSION;
    arrays.sample_size--;
    SIZE(palpate_body_from_arrays(&arrays, &other, &error));
    arrays.sample_size++;
    arrays.vertex_count = 3;
    NULL_(palpate_body_from_arrays(&arrays, &other, &error));
    NULL_(palpate_body_from_spec(NULL, NULL, 0, NULL, NULL, &other, &error));
    NULL_(palpate_body_from_spec("x.toml", NULL, 0, NULL, NULL, NULL, &error));
    if (palpate_features() & PALPATE_FEATURE_BUILD)
        EXPECT(PALPATE_STATUS_BODY, palpate_body_from_spec("x.toml", NULL, 0, NULL, NULL, &other, &error));
    else
        EXPECT(PALPATE_STATUS_UNSUPPORTED, palpate_body_from_spec("x.toml", NULL, 0, NULL, NULL, &other, &error));
    if (other.id != 0) {
        fprintf(stderr, "a handle was written by a call that failed\n");
        wrong++;
    }
}

static void contacts(palpate_body ball, palpate_body other)
{
    palpate_contact_options options = PALPATE_CONTACT_OPTIONS_INIT;
    palpate_tool_state tool = PALPATE_TOOL_STATE_INIT;
    palpate_output output = PALPATE_OUTPUT_INIT;
    palpate_ledger ledger = PALPATE_LEDGER_INIT;
    palpate_counters counters = PALPATE_COUNTERS_INIT;
    palpate_path path = PALPATE_PATH_INIT;
    palpate_trace trace = PALPATE_TRACE_INIT;
    palpate_contact contact, elsewhere, snapshot, pair[2];
    palpate_path paths[2];
    palpate_trace traces[2];
    palpate_contact foreign;
    double times[2] = {0.0, 1e-3}, positions[6] = {0, 0, 0.031, 0, 0, 0.029}, *forces = malloc(6 * sizeof(double));

    NULL_(palpate_contact_create(ball, NULL, NULL, &error));
    options.struct_size = 4;
    SIZE(palpate_contact_create(ball, &options, &contact, &error));
    options.struct_size = sizeof options;
    options.abi_version++;
    VERSION(palpate_contact_create(ball, &options, &contact, &error));
    options.abi_version--;
    options.slip_rule = 9;
    INVALID(palpate_contact_create(ball, &options, &contact, &error));
    SAYS("slip rule 9");
    options.slip_rule = 0;
    options.friction_scale = -1;
    INVALID(palpate_contact_create(ball, &options, &contact, &error));
    options.friction_scale = 1;
    options.tank = 3;
    INVALID(palpate_contact_create(ball, &options, &contact, &error));
    options.tank = 0;
    options.ablation = 4;
    INVALID(palpate_contact_create(ball, &options, &contact, &error));
    options.ablation = 0;
    OK(palpate_contact_create(ball, &options, &contact, &error));
    OK(palpate_contact_create(other, NULL, &elsewhere, &error));

    NULL_(palpate_contact_step(contact, NULL, 1e-3, &output));
    NULL_(palpate_contact_step(contact, &tool, 1e-3, NULL));
    NULL_(palpate_contact_step(contact, (const palpate_tool_state *)((const char *)&tool + 1), 1e-3, &output));
    tool.struct_size = 0;
    SIZE(palpate_contact_step(contact, &tool, 1e-3, &output));
    tool.struct_size = sizeof tool;
    output.struct_size += 8;
    SIZE(palpate_contact_step(contact, &tool, 1e-3, &output));
    output.struct_size = sizeof output;
    tool.position_m[2] = 0.031;
    OK(palpate_contact_step(contact, &tool, 1e-3, &output));
    /* What is wrong with a pose or a time is a flag. */
    tool.position_m[0] = NAN;
    OK(palpate_contact_step(contact, &tool, 1e-3, &output));
    if (!(output.flags & PALPATE_FLAG_INVALID_POSE) || output.force_n[0] != 0.0)
        wrong++;
    tool.position_m[0] = 0.0;
    tool.position_m[2] = 0.029;
    OK(palpate_contact_step(contact, &tool, -1.0, &output));
    if (!(output.flags & PALPATE_FLAG_INVALID_TIME) || !(output.force_n[2] > 0.0))
        wrong++;

    /* Another body's contact. */
    EXPECT(PALPATE_STATUS_OTHER_BODY, palpate_contact_restore(contact, elsewhere));
    EXPECT(PALPATE_STATUS_OTHER_BODY, palpate_contact_restore(elsewhere, contact));
    OK(palpate_contact_restore(contact, contact));
    NULL_(palpate_contact_snapshot(contact, NULL));
    OK(palpate_contact_snapshot(contact, &snapshot));
    OK(palpate_contact_restore(contact, snapshot));
    INVALID(palpate_contact_set_friction_scale(contact, NAN));
    INVALID(palpate_contact_set_slip_rule(contact, 0));
    NULL_(palpate_contact_ledger(contact, NULL));
    ledger.struct_size = 1;
    SIZE(palpate_contact_ledger(contact, &ledger));
    NULL_(palpate_contact_counters(contact, NULL));
    counters.struct_size = 1;
    SIZE(palpate_contact_counters(contact, &counters));

    path.count = 2;
    path.times_s = times;
    NULL_(palpate_contact_rollout(contact, &path, &trace, &error));
    path.positions_m = positions;
    OK(palpate_contact_rollout(contact, &path, &trace, &error));
    trace.forces_n = forces; /* exactly as long as it must be */
    OK(palpate_contact_rollout(contact, &path, &trace, &error));
    path.count = SIZE_MAX;
    INVALID(palpate_contact_rollout(contact, &path, &trace, &error));
    path.count = 2;
    NULL_(palpate_contact_rollout(contact, NULL, &trace, &error));
    NULL_(palpate_contact_rollout(contact, &path, NULL, &error));
    path.struct_size = 0;
    SIZE(palpate_contact_rollout(contact, &path, &trace, &error));
    path.struct_size = sizeof path;
    trace.struct_size = 0;
    SIZE(palpate_contact_rollout(contact, &path, &trace, &error));
    trace.struct_size = sizeof trace;
    paths[0] = paths[1] = path;
    traces[0] = traces[1] = trace;
    traces[1].forces_n = NULL;
    pair[0] = pair[1] = contact;
    EXPECT(PALPATE_STATUS_BUSY, palpate_rollout_many(pair, paths, traces, 2, 0, &error)); /* named twice */
    pair[1] = snapshot;
    OK(palpate_rollout_many(pair, paths, traces, 2, 0, &error));
    OK(palpate_rollout_many(pair, paths, traces, 2, 1000, &error));
    OK(palpate_rollout_many(NULL, NULL, NULL, 0, 0, &error));
    NULL_(palpate_rollout_many(NULL, paths, traces, 2, 0, &error));
    paths[1].struct_size = 0;
    SIZE(palpate_rollout_many(pair, paths, traces, 2, 0, &error));
    SAYS("path or trace 1");
    paths[1].struct_size = sizeof path;

    /* Of another kind. */
    foreign.id = ball.id;
    CLOSED(palpate_contact_step(foreign, &tool, 1e-3, &output));
    /* Closed. */
    OK(palpate_contact_close(snapshot));
    CLOSED(palpate_contact_close(snapshot));
    CLOSED(palpate_contact_step(snapshot, &tool, 1e-3, &output));
    CLOSED(palpate_contact_restore(contact, snapshot));
    CLOSED(palpate_contact_snapshot(snapshot, &foreign));
    CLOSED(palpate_contact_forget(snapshot));
    CLOSED(palpate_contact_set_tank(snapshot, 1));
    CLOSED(palpate_contact_set_friction_scale(snapshot, 1.0));
    CLOSED(palpate_contact_set_slip_rule(snapshot, PALPATE_SLIP_PAPER));
    CLOSED(palpate_rollout_many(pair, paths, traces, 2, 0, &error));
    SAYS("contact 1");
    ledger.struct_size = sizeof ledger;
    CLOSED(palpate_contact_ledger(snapshot, &ledger));
    counters.struct_size = sizeof counters;
    CLOSED(palpate_contact_counters(snapshot, &counters));
    /* The place of what was closed is used again, and the old handle does not open it. */
    OK(palpate_contact_create(ball, NULL, &foreign, &error));
    CLOSED(palpate_contact_step(snapshot, &tool, 1e-3, &output));
    OK(palpate_contact_close(foreign));
    OK(palpate_contact_close(elsewhere));
    OK(palpate_contact_close(contact));
    foreign.id = 0;
    CLOSED(palpate_contact_close(foreign));
    foreign.id = UINT64_MAX;
    CLOSED(palpate_contact_close(foreign));
    free(forces);
}

struct rider {
    palpate_contact contact;
    palpate_status status;
    atomic_int is_over;
};

static void *ride(void *user)
{
    enum { POSES = 200000 };
    struct rider *rider = user;
    palpate_path path = PALPATE_PATH_INIT;
    palpate_trace trace = PALPATE_TRACE_INIT;
    double *times = malloc(4 * POSES * sizeof(double)), *positions = times + POSES;
    int k;
    for (k = 0; k < POSES; k++) {
        times[k] = 1e-3 * k;
        positions[3 * k] = 1e-3 * sin(1e-3 * k);
        positions[3 * k + 1] = 0.0;
        positions[3 * k + 2] = 0.031 - (k < 100 ? 3e-5 * k : 3e-3);
    }
    path.count = POSES;
    path.times_s = times;
    path.positions_m = positions;
    /* The other thread may be in it when this one comes. */
    do
        rider->status = palpate_contact_rollout(rider->contact, &path, &trace, NULL);
    while (rider->status == PALPATE_STATUS_BUSY);
    free(times);
    atomic_store(&rider->is_over, 1);
    return NULL;
}

struct crowd {
    palpate_body body;
    double sum_n;
    long failed;
};

/* Three thousand contacts, a hundred at a time: made, pressed and dragged, copied, closed. */
static void *come_and_go(void *user)
{
    enum { ROUNDS = 30, AT_A_TIME = 100, POSES = 12 };
    struct crowd *crowd = user;
    palpate_tool_state tool = PALPATE_TOOL_STATE_INIT;
    palpate_output output = PALPATE_OUTPUT_INIT;
    palpate_contact contacts[AT_A_TIME], copy;
    int round, c, k;
    for (round = 0; round < ROUNDS; round++) {
        for (c = 0; c < AT_A_TIME; c++)
            crowd->failed += palpate_contact_create(crowd->body, NULL, &contacts[c], NULL) != PALPATE_STATUS_OK;
        for (k = 0; k < POSES; k++) {
            for (c = 0; c < AT_A_TIME; c++) {
                tool.position_m[0] = 1e-5 * c + 2e-4 * k;
                tool.position_m[2] = 0.0305 - 3e-4 * k;
                crowd->failed += palpate_contact_step(contacts[c], &tool, 1e-3, &output) != PALPATE_STATUS_OK;
                crowd->sum_n += output.force_n[0] + output.force_n[2];
            }
        }
        for (c = 0; c < AT_A_TIME; c++) {
            crowd->failed += palpate_contact_snapshot(contacts[c], &copy) != PALPATE_STATUS_OK;
            crowd->failed += palpate_contact_restore(contacts[(c + 1) % AT_A_TIME], copy) != PALPATE_STATUS_OK;
            crowd->failed += palpate_contact_close(copy) != PALPATE_STATUS_OK;
        }
        for (c = 0; c < AT_A_TIME; c++) {
            crowd->failed += palpate_contact_close(contacts[c]) != PALPATE_STATUS_OK;
            crowd->failed += palpate_contact_close(contacts[c]) != PALPATE_STATUS_CLOSED;
        }
    }
    return NULL;
}

/* Thousands of contacts on one body, from two threads that know nothing of each other. */
static void crowds(palpate_body ball)
{
    struct crowd crowds[2] = {{{0}, 0, 0}, {{0}, 0, 0}};
    pthread_t thread;
    crowds[0].body = crowds[1].body = ball;
    if (pthread_create(&thread, NULL, come_and_go, &crowds[0])) {
        wrong++;
        return;
    }
    come_and_go(&crowds[1]);
    pthread_join(thread, NULL);
    if (crowds[0].failed || crowds[1].failed || crowds[0].sum_n != crowds[1].sum_n || !(crowds[0].sum_n > 100)) {
        fprintf(stderr, "two crowds of contacts: %ld and %ld calls failed, %.17g and %.17g N\n", crowds[0].failed,
                crowds[1].failed, crowds[0].sum_n, crowds[1].sum_n);
        wrong++;
    }
}

/* Two threads on one contact. */
static void threads(palpate_body ball)
{
    struct rider rider = {{0}, -1, 0};
    palpate_tool_state tool = PALPATE_TOOL_STATE_INIT;
    palpate_output output = PALPATE_OUTPUT_INIT;
    pthread_t thread;
    long busy = 0, done = 0;

    OK(palpate_contact_create(ball, NULL, &rider.contact, &error));
    tool.position_m[2] = 0.031;
    if (pthread_create(&thread, NULL, ride, &rider)) {
        wrong++;
        return;
    }
    while (!atomic_load(&rider.is_over)) {
        const palpate_status status = palpate_contact_step(rider.contact, &tool, 1e-3, &output);
        busy += status == PALPATE_STATUS_BUSY;
        done += status == PALPATE_STATUS_OK;
        if (status != PALPATE_STATUS_BUSY && status != PALPATE_STATUS_OK)
            wrong++;
        if (status == PALPATE_STATUS_BUSY && palpate_contact_close(rider.contact) == PALPATE_STATUS_OK)
            break; /* it had just ended */
    }
    pthread_join(thread, NULL);
    OK(rider.status);
    if (busy == 0) {
        fprintf(stderr, "two threads on one contact: never busy, %ld steps\n", done);
        wrong++;
    }
    palpate_contact_close(rider.contact);
    CLOSED(palpate_contact_close(rider.contact));
}

static palpate_fault open_badly(void *user, palpate_capabilities *can, char *message, size_t bytes)
{
    (void)user;
    (void)can;
    snprintf(message, bytes, "the cable is out");
    return PALPATE_FAULT_DISCONNECTED;
}

static palpate_fault open_and_say_nothing(void *user, palpate_capabilities *can, char *message, size_t bytes)
{
    (void)user;
    (void)can;
    (void)message;
    (void)bytes;
    return PALPATE_FAULT_NONE;
}

static palpate_fault read_nothing(void *user, double now_s, palpate_sample *sample)
{
    (void)user;
    (void)now_s;
    (void)sample;
    return PALPATE_FAULT_NONE;
}

static palpate_fault write_nothing(void *user, const palpate_command *command)
{
    (void)user;
    (void)command;
    return PALPATE_FAULT_NONE;
}

static void close_and_count(void *user)
{
    ++*(int *)user;
}

static void sessions(palpate_body ball)
{
    palpate_device device = PALPATE_DEVICE_INIT;
    palpate_record record = PALPATE_RECORD_INIT;
    palpate_outcome outcome = PALPATE_OUTCOME_INIT;
    palpate_session session = {0};
    const char *quiet = "{\"device\": \"simulated:touch\", \"seconds\": 60, \"real_time\": {\"priority\": 0, \"core\": -1, "
                        "\"lock_memory\": false}, \"patience\": {\"late_s\": 5, \"finder_s\": 10}}";
    char small[1], text[4096];
    size_t needed = 0;
    uint32_t is_over = 0;
    int closed = 0;

    NULL_(palpate_session_prepare(ball, NULL, NULL, NULL, &error));
    INVALID(palpate_session_prepare(ball, "{\"device\": ", NULL, &session, &error));
    SAYS("JSON");
    INVALID(palpate_session_prepare(ball, "{\"rate\": 1000}", NULL, &session, &error));
    SAYS("rate");
    EXPECT(PALPATE_STATUS_SESSION, palpate_session_prepare(ball, "{\"rate_hz\": 1}", NULL, &session, &error));
    SAYS("rate_hz");
    EXPECT(PALPATE_STATUS_SESSION, palpate_session_prepare(ball, "{\"clock\": \"virtual\"}", NULL, &session, &error));

    /* A device's table that is not whole, or not of this version; one that can't be opened; one that says nothing of itself. */
    NULL_(palpate_device_check(NULL, &error));
    NULL_(palpate_device_check(&device, &error));
    SAYS("open is null");
    device.user = &closed;
    device.open = open_badly;
    device.read = read_nothing;
    device.write = write_nothing;
    device.close = close_and_count;
    OK(palpate_device_check(&device, &error));
    device.struct_size -= 8;
    SIZE(palpate_session_prepare(ball, quiet, &device, &session, &error));
    device.struct_size += 8;
    device.abi_version++;
    VERSION(palpate_session_prepare(ball, quiet, &device, &session, &error));
    device.abi_version--;
    EXPECT(PALPATE_STATUS_SESSION, palpate_session_prepare(ball, quiet, &device, &session, &error));
    SAYS("the cable is out");
    if (closed != 0)
        wrong++; /* what was not opened is not closed */
    device.open = open_and_say_nothing;
    EXPECT(PALPATE_STATUS_SESSION, palpate_session_prepare(ball, quiet, &device, &session, &error));
    SAYS("max_force_n is 0");
    if (closed != 1)
        wrong++;

    CLOSED(palpate_session_start(session, &error));
    CLOSED(palpate_session_latest(session, &record));
    CLOSED(palpate_session_stop(session));
    OK(palpate_session_prepare(ball, quiet, NULL, &session, &error));
    EXPECT(PALPATE_STATUS_NOTHING, palpate_session_latest(session, &record));
    EXPECT(PALPATE_STATUS_NOTHING, palpate_session_pause(session));
    EXPECT(PALPATE_STATUS_NOTHING, palpate_session_wait(session, 0, &is_over));
    EXPECT(PALPATE_STATUS_NOTHING, palpate_session_set_friction_scale(session, 1.0, &error));
    OK(palpate_session_notes(session, text, sizeof text, &needed));
    if (needed != strlen(text) + 1)
        wrong++;
    OK(palpate_session_start(session, &error));
    EXPECT(PALPATE_STATUS_NOTHING, palpate_session_start(session, &error));
    NULL_(palpate_session_latest(session, NULL));
    record.struct_size = 576;
    SIZE(palpate_session_latest(session, &record));
    record.struct_size = sizeof record;
    EXPECT(PALPATE_STATUS_SESSION, palpate_session_set_force_limit(session, 1e6, 0, &error));
    SAYS("force_max_n");
    EXPECT(PALPATE_STATUS_SESSION, palpate_session_set_friction_scale(session, -1.0, &error));
    INVALID(palpate_session_set_slip_rule(session, 7, &error));
    OK(palpate_session_set_friction_scale(session, 0.5, &error));
    OK(palpate_session_set_slip_rule(session, PALPATE_SLIP_EXACT, &error));
    OK(palpate_session_change_body(session, ball, &error));
    OK(palpate_session_pause(session));
    OK(palpate_session_resume(session));
    NULL_(palpate_session_wait(session, 0, NULL));
    EXPECT(PALPATE_STATUS_TOO_SMALL, palpate_session_summary(session, small, 1, &needed));
    NULL_(palpate_session_summary(session, NULL, 10, &needed));
    OK(palpate_session_summary(session, text, sizeof text, NULL));
    OK(palpate_session_stop(session));
    OK(palpate_session_wait(session, 60, &is_over));
    if (!is_over)
        wrong++;
    EXPECT(PALPATE_STATUS_SESSION, palpate_session_set_friction_scale(session, 0.7, &error));
    SAYS("ended");
    outcome.struct_size = 8;
    SIZE(palpate_session_close(session, &outcome, &error));
    outcome.struct_size = sizeof outcome;
    OK(palpate_session_close(session, &outcome, &error));
    if (outcome.end != PALPATE_END_ASKED || !outcome.is_well || outcome.periods == 0) {
        fprintf(stderr, "a session ended with: %s\n", outcome.message);
        wrong++;
    }
    CLOSED(palpate_session_close(session, &outcome, &error));
    CLOSED(palpate_session_wait(session, 0, &is_over));
    CLOSED(palpate_session_notes(session, text, sizeof text, NULL));
    /* One that was never started, and one that is stopped at once. */
    OK(palpate_session_prepare(ball, quiet, NULL, &session, &error));
    OK(palpate_session_close(session, NULL, NULL));
    OK(palpate_session_prepare(ball, quiet, NULL, &session, &error));
    OK(palpate_session_start(session, &error));
    OK(palpate_session_stop_at_once(session));
    OK(palpate_session_close(session, &outcome, &error));
    if (outcome.end != PALPATE_END_EMERGENCY)
        wrong++;
}

int main(int argc, char **argv)
{
    palpate_body ball = {0}, other = {0};
    palpate_body_info info = PALPATE_BODY_INFO_INIT;
    palpate_body_arrays arrays = PALPATE_BODY_ARRAYS_INIT;
    double corners[9] = {0, 0, 0, 0.1, 0, 0, 0, 0.1, 0};
    uint32_t triangle[3] = {0, 1, 2};
    palpate_sample_row rows[2] = {{0, PALPATE_NORMAL, {0, 0, 0}, 1e-3, 1.0}, {0, PALPATE_LATERAL, {0, 0, 0}, 1e-3, 1.0}};

    VERSION(palpate_check_abi(PALPATE_ABI_VERSION + 1));
    OK(palpate_check_abi(PALPATE_ABI_VERSION));
    if (palpate_abi_version() != PALPATE_ABI_VERSION || strlen(palpate_version()) < 5 || !palpate_status_text(-7)[0])
        wrong++;
    OK(make_ball(&ball, &error));
    if (argc > 1 && strcmp(argv[1], "threads") == 0) {
        threads(ball);
        crowds(ball);
        OK(palpate_body_close(ball));
        printf("%d wrong\n", wrong);
        return wrong == 0 ? 0 : 1;
    }
    arrays.positions_m = corners;
    arrays.vertex_count = 3;
    arrays.triangles = triangle;
    arrays.triangle_count = 1;
    arrays.samples = rows;
    arrays.sample_count = 2;
    arrays.is_open = 1;
    arrays.default_friction = 0.3;
    OK(palpate_body_from_arrays(&arrays, &other, &error));
    if (error.message[0])
        fprintf(stderr, "%s\n", error.message);

    bodies(ball);
    contacts(ball, other);
    threads(ball);
    crowds(ball);
    sessions(ball);

    OK(palpate_body_close(ball));
    CLOSED(palpate_body_close(ball));
    CLOSED(palpate_body_inspect(ball, &info));
    CLOSED(palpate_body_save(ball, "x.body", &error));
    OK(palpate_body_close(other));
    printf("%d wrong\n", wrong);
    return wrong == 0 ? 0 : 1;
}
