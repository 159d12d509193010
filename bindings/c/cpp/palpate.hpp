// palpate for C++17: owners over the C interface (palpate.h), in this header alone. What each function does, its units, frames and
// real-time behaviour are said there.
//
// Every call comes twice: one that returns a Status and throws nothing, named try_..., and one that returns its result and throws
// palpate::Error. The second are left out where exceptions are off, or where PALPATE_NO_EXCEPTIONS is defined.
//
//     palpate::Body body = palpate::Body::open("liver.body");
//     palpate::Contact contact(body);
//     palpate::Output output = contact.step(palpate::ToolState({0, 0, 0.031}), 1e-3);
//
// MIT OR Apache-2.0.

#ifndef PALPATE_HPP
#define PALPATE_HPP

#if __cplusplus < 201703L && !(defined(_MSVC_LANG) && _MSVC_LANG >= 201703L)
#error "palpate.hpp needs C++17: compile with -std=c++17 or newer"
#endif

#include "palpate.h"

#include <array>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#if !defined(PALPATE_NO_EXCEPTIONS) && !defined(__cpp_exceptions) && !defined(_CPPUNWIND)
#define PALPATE_NO_EXCEPTIONS
#endif
#ifndef PALPATE_NO_EXCEPTIONS
#include <stdexcept>
#endif

namespace palpate {

using Vector = std::array<double, 3>;
using Quaternion = std::array<double, 4>; // w x y z

/// What a call returned.
enum class Status : palpate_status {
    ok = PALPATE_STATUS_OK,
    null = PALPATE_STATUS_NULL,
    wrong_size = PALPATE_STATUS_WRONG_SIZE,
    wrong_version = PALPATE_STATUS_WRONG_VERSION,
    closed = PALPATE_STATUS_CLOSED,
    busy = PALPATE_STATUS_BUSY,
    other_body = PALPATE_STATUS_OTHER_BODY,
    invalid = PALPATE_STATUS_INVALID,
    body = PALPATE_STATUS_BODY,
    session = PALPATE_STATUS_SESSION,
    too_small = PALPATE_STATUS_TOO_SMALL,
    cancelled = PALPATE_STATUS_CANCELLED,
    unsupported = PALPATE_STATUS_UNSUPPORTED,
    nothing = PALPATE_STATUS_NOTHING,
    panic = PALPATE_STATUS_PANIC,
};

/// A status in words.
inline const char *text(Status status) noexcept {
    return palpate_status_text(static_cast<palpate_status>(status));
}

/// Where try_... functions write what was wrong.
struct Message : palpate_error {
    Message() noexcept : palpate_error PALPATE_ERROR_INIT {}
    const char *words() const noexcept { return message; }
};

#ifndef PALPATE_NO_EXCEPTIONS
/// Why a call failed.
class Error : public std::runtime_error {
public:
    Error(Status status, const std::string &words) : std::runtime_error(words), status_(status) {}
    Status status() const noexcept { return status_; }

private:
    Status status_;
};
#endif

/// Pointer and length, for arrays that somebody else owns; as std::span, which C++17 has not.
template <class T> class Span {
public:
    constexpr Span() noexcept = default;
    constexpr Span(T *data, std::size_t size) noexcept : data_(data), size_(size) {}
    template <std::size_t N> constexpr Span(T (&array)[N]) noexcept : data_(array), size_(N) {}
    template <class C, class = decltype(static_cast<T *>(std::declval<C &>().data()))>
    constexpr Span(C &&container) noexcept : data_(container.data()), size_(container.size()) {}
    constexpr T *data() const noexcept { return data_; }
    constexpr std::size_t size() const noexcept { return size_; }
    constexpr bool empty() const noexcept { return size_ == 0; }
    constexpr T &operator[](std::size_t i) const noexcept { return data_[i]; }
    constexpr T *begin() const noexcept { return data_; }
    constexpr T *end() const noexcept { return data_ + size_; }

private:
    T *data_ = nullptr;
    std::size_t size_ = 0;
};

namespace detail {
inline Status status(palpate_status status) noexcept { return static_cast<Status>(status); }

#ifndef PALPATE_NO_EXCEPTIONS
inline void check(Status status) {
    if (status != Status::ok) throw Error(status, text(status));
}
inline void check(Status status, const Message &message) {
    if (status != Status::ok) throw Error(status, message.message[0] ? message.message : text(status));
}
#endif

/// A handle that is closed once.
template <class Handle, palpate_status (*close)(Handle)> class Owner {
public:
    Owner() noexcept = default;
    explicit Owner(Handle handle) noexcept : handle_(handle) {}
    Owner(Owner &&other) noexcept : handle_(std::exchange(other.handle_, Handle{0})) {}
    Owner &operator=(Owner &&other) noexcept {
        std::swap(handle_, other.handle_);
        return *this;
    }
    Owner(const Owner &) = delete;
    Owner &operator=(const Owner &) = delete;
    ~Owner() {
        if (handle_.id != 0) close(handle_);
    }
    Handle get() const noexcept { return handle_; }
    Handle *put() noexcept { return &handle_; }
    Handle release() noexcept { return std::exchange(handle_, Handle{0}); }

private:
    Handle handle_{0};
};

/// A session that another thread is just looking at is not left running.
inline palpate_status close_session(palpate_session session) {
    palpate_status status;
    while ((status = palpate_session_close(session, nullptr, nullptr)) == PALPATE_STATUS_BUSY) std::this_thread::yield();
    return status;
}
inline palpate_error *raw(Message *message) noexcept { return message; }
} // namespace detail

/// Where the tool is, in the body's frame, m.
struct ToolState : palpate_tool_state {
    ToolState() noexcept : palpate_tool_state PALPATE_TOOL_STATE_INIT {}
    explicit ToolState(const Vector &at) noexcept : ToolState() { std::memcpy(position_m, at.data(), sizeof position_m); }
    ToolState(const Vector &at, const Quaternion &turned) noexcept : ToolState(at) {
        std::memcpy(orientation, turned.data(), sizeof orientation);
    }
};

/// One sample of what a device renders.
struct Output : palpate_output {
    Output() noexcept : palpate_output PALPATE_OUTPUT_INIT {}
    Vector force() const noexcept { return {force_n[0], force_n[1], force_n[2]}; }
    Vector torque() const noexcept { return {torque_nm[0], torque_nm[1], torque_nm[2]}; }
    bool has(std::uint32_t flag) const noexcept { return (flags & flag) != 0; }
};

/// Energies of a contact, J.
struct Ledger : palpate_ledger {
    Ledger() noexcept : palpate_ledger PALPATE_LEDGER_INIT {}
};

/// How often things happened.
struct Counters : palpate_counters {
    Counters() noexcept : palpate_counters PALPATE_COUNTERS_INIT {}
};

/// What a body is.
struct BodyInfo : palpate_body_info {
    BodyInfo() noexcept : palpate_body_info PALPATE_BODY_INFO_INIT {}
};

/// For which motions a body is certified; a device in its loop.
struct CertifyOptions : palpate_certify_options {
    CertifyOptions() noexcept : palpate_certify_options PALPATE_CERTIFY_OPTIONS_INIT {}
};
struct LoopDevice : palpate_loop_device {
    LoopDevice() noexcept : palpate_loop_device PALPATE_LOOP_DEVICE_INIT {}
    static Status try_of(const char *name, double rate_hz, LoopDevice &device, Message *message = nullptr) noexcept {
        return detail::status(palpate_loop_device_of(name, rate_hz, &device, detail::raw(message)));
    }
};

/// What is proved of a body. NaN stands for what is not known.
struct Certificate : palpate_certificate {
    Certificate() noexcept : palpate_certificate PALPATE_CERTIFICATE_INIT {}
};

/// How a contact is to be.
struct ContactOptions : palpate_contact_options {
    ContactOptions() noexcept : palpate_contact_options PALPATE_CONTACT_OPTIONS_INIT {}
};

/// The latest period of a session.
struct Record : palpate_record {
    Record() noexcept : palpate_record{} { struct_size = sizeof(palpate_record); }
};

/// What became of a session.
struct Outcome : palpate_outcome {
    Outcome() noexcept : palpate_outcome PALPATE_OUTCOME_INIT {}
};

/// What a body is made of: set what there is, and leave the rest.
struct BodyArrays : palpate_body_arrays {
    BodyArrays() noexcept : palpate_body_arrays PALPATE_BODY_ARRAYS_INIT {}
    /// Vertices, m (x y z each), and triangles, counter-clockwise from outside.
    BodyArrays &surface(Span<const double> positions, Span<const std::uint32_t> corners) noexcept {
        positions_m = positions.data();
        vertex_count = positions.size() / 3;
        triangles = corners.data();
        triangle_count = corners.size() / 3;
        return *this;
    }
    BodyArrays &measured(Span<const palpate_sample_row> rows) noexcept {
        samples = rows.data();
        sample_count = rows.size();
        return *this;
    }
};

/// A body: read-only, shared by any number of contacts and threads.
class Body {
public:
    Body() noexcept = default;
    /// Takes over a handle of the C interface, and closes it.
    explicit Body(palpate_body handle) noexcept : owner_(handle) {}

    static Status try_open(const char *path, Body &body, Message *message = nullptr) noexcept {
        Body opened;
        Status s = detail::status(palpate_body_open(path, opened.owner_.put(), detail::raw(message)));
        return opened.move_if(s, body);
    }
    static Status try_from_memory(Span<const std::uint8_t> bytes, Body &body, Message *message = nullptr) noexcept {
        Body opened;
        Status s = detail::status(
            palpate_body_from_memory(bytes.data(), bytes.size(), opened.owner_.put(), detail::raw(message)));
        return opened.move_if(s, body);
    }
    static Status try_from_arrays(const BodyArrays &arrays, Body &body, Message *message = nullptr) noexcept {
        Body made;
        Status s = detail::status(palpate_body_from_arrays(&arrays, made.owner_.put(), detail::raw(message)));
        return made.move_if(s, body);
    }
    /// From a spec; `progress(done, of, message)` returns false to end it, is called from the library's threads, and throws nothing.
    template <class Progress>
    static Status try_from_spec(const char *spec, const char *work_folder, std::uint32_t threads, Progress &progress,
                                Body &body, Message *message = nullptr) noexcept {
        Body made;
        auto told = [](void *user, const palpate_progress *p) noexcept -> std::int32_t {
            return (*static_cast<Progress *>(user))(p->points_done, p->points, p->message) ? 0 : 1;
        };
        Status s = detail::status(palpate_body_from_spec(spec, work_folder, threads, told, &progress, made.owner_.put(),
                                                         detail::raw(message)));
        return made.move_if(s, body);
    }
    Status try_save(const char *path, Message *message = nullptr) const noexcept {
        return detail::status(palpate_body_save(handle(), path, detail::raw(message)));
    }
    Status try_inspect(BodyInfo &info) const noexcept { return detail::status(palpate_body_inspect(handle(), &info)); }
    /// `progress(done, of)` returns false to end it, is called from the library's threads, and throws nothing.
    template <class Progress>
    Status try_certify(const CertifyOptions &options, Progress &progress, Certificate &certificate,
                       Message *message = nullptr) const noexcept {
        auto told = [](void *user, const palpate_progress *p) noexcept -> std::int32_t {
            return (*static_cast<Progress *>(user))(p->points_done, p->points) ? 0 : 1;
        };
        return detail::status(
            palpate_body_certify(handle(), &options, told, &progress, &certificate, detail::raw(message)));
    }
    Status try_surface(Span<double> positions_m, Span<std::uint32_t> triangles) const noexcept {
        return detail::status(palpate_body_surface(handle(), positions_m.data(), positions_m.size() / 3, triangles.data(),
                                                   triangles.size() / 3));
    }

#ifndef PALPATE_NO_EXCEPTIONS
    static Body open(const std::string &path) {
        return result([&](Body &b, Message *m) { return try_open(path.c_str(), b, m); });
    }
    static Body from_memory(Span<const std::uint8_t> bytes) {
        return result([&](Body &b, Message *m) { return try_from_memory(bytes, b, m); });
    }
    static Body from_arrays(const BodyArrays &arrays) {
        return result([&](Body &b, Message *m) { return try_from_arrays(arrays, b, m); });
    }
    static Body from_spec(const std::string &spec) {
        auto silent = [](std::uint64_t, std::uint64_t, const char *) { return true; };
        return result([&](Body &b, Message *m) { return try_from_spec(spec.c_str(), nullptr, 0, silent, b, m); });
    }
    void save(const std::string &path) const {
        Message message;
        detail::check(try_save(path.c_str(), &message), message);
    }
    BodyInfo inspect() const {
        BodyInfo info;
        detail::check(try_inspect(info));
        return info;
    }
    Certificate certify(const CertifyOptions &options = CertifyOptions()) const {
        Certificate certificate;
        Message message;
        auto silent = [](std::uint64_t, std::uint64_t) { return true; };
        detail::check(try_certify(options, silent, certificate, &message), message);
        return certificate;
    }
#endif

    palpate_body handle() const noexcept { return owner_.get(); }
    explicit operator bool() const noexcept { return handle().id != 0; }

private:
    Status move_if(Status status, Body &to) noexcept {
        if (status == Status::ok) to = std::move(*this);
        return status;
    }
#ifndef PALPATE_NO_EXCEPTIONS
    template <class Call> static Body result(Call call) {
        Body body;
        Message message;
        detail::check(call(body, &message), message);
        return body;
    }
#endif
    detail::Owner<palpate_body, palpate_body_close> owner_;
};

/// A tool's path, and where what it meets goes; nothing is copied. Arrays of none are left out.
struct Path {
    Span<const double> times_s;
    Span<const double> positions_m;  // x y z each
    Span<const double> orientations; // w x y z each
};
struct Trace {
    Span<double> forces_n;  // x y z each
    Span<double> torques_nm; // x y z each
    Span<std::uint32_t> flags;
    Span<palpate_ledger> energies;
    Span<palpate_output> outputs;
};

/// A contact: all that evolves while one tool touches one body. One thread at a time; it keeps its body.
class Contact {
public:
    Contact() noexcept = default;

    static Status try_create(const Body &body, const ContactOptions &options, Contact &contact,
                             Message *message = nullptr) noexcept {
        Contact made;
        Status s = detail::status(
            palpate_contact_create(body.handle(), &options, made.owner_.put(), detail::raw(message)));
        if (s == Status::ok) contact = std::move(made);
        return s;
    }
    /// One sample. Real-time.
    Status try_step(const ToolState &tool, double dt_s, Output &output) noexcept {
        return detail::status(palpate_contact_step(handle(), &tool, dt_s, &output));
    }
    Status try_snapshot(Contact &snapshot) const noexcept {
        Contact made;
        Status s = detail::status(palpate_contact_snapshot(handle(), made.owner_.put()));
        if (s == Status::ok) snapshot = std::move(made);
        return s;
    }
    /// Real-time.
    Status try_restore(const Contact &snapshot) noexcept {
        return detail::status(palpate_contact_restore(handle(), snapshot.handle()));
    }
    Status try_forget() noexcept { return detail::status(palpate_contact_forget(handle())); }
    Status try_set_friction_scale(double scale) noexcept {
        return detail::status(palpate_contact_set_friction_scale(handle(), scale));
    }
    Status try_set_tank(bool tank) noexcept { return detail::status(palpate_contact_set_tank(handle(), tank)); }
    Status try_set_partial_slip(bool partial_slip) noexcept {
        return detail::status(palpate_contact_set_partial_slip(handle(), partial_slip));
    }
    Status try_set_slip_rule(std::uint32_t rule) noexcept {
        return detail::status(palpate_contact_set_slip_rule(handle(), rule));
    }
    Status try_ledger(Ledger &ledger) const noexcept { return detail::status(palpate_contact_ledger(handle(), &ledger)); }
    Status try_counters(Counters &counters) const noexcept {
        return detail::status(palpate_contact_counters(handle(), &counters));
    }
    Status try_rollout(const Path &path, const Trace &trace, Message *message = nullptr) noexcept {
        palpate_path p;
        palpate_trace t;
        Status s = raw(path, trace, p, t);
        return s == Status::ok ? detail::status(palpate_contact_rollout(handle(), &p, &t, detail::raw(message))) : s;
    }

#ifndef PALPATE_NO_EXCEPTIONS
    explicit Contact(const Body &body, const ContactOptions &options = ContactOptions()) {
        Message message;
        detail::check(try_create(body, options, *this, &message), message);
    }
    Output step(const ToolState &tool, double dt_s) {
        Output output;
        detail::check(try_step(tool, dt_s, output));
        return output;
    }
    Contact snapshot() const {
        Contact made;
        detail::check(try_snapshot(made));
        return made;
    }
    void restore(const Contact &snapshot) { detail::check(try_restore(snapshot)); }
    Ledger ledger() const {
        Ledger ledger;
        detail::check(try_ledger(ledger));
        return ledger;
    }
    Counters counters() const {
        Counters counters;
        detail::check(try_counters(counters));
        return counters;
    }
    /// Forces along a path, x y z each, N.
    std::vector<double> rollout(const Path &path) {
        std::vector<double> forces(3 * path.times_s.size());
        Trace trace;
        trace.forces_n = forces;
        Message message;
        detail::check(try_rollout(path, trace, &message), message);
        return forces;
    }
#endif

    palpate_contact handle() const noexcept { return owner_.get(); }
    explicit operator bool() const noexcept { return handle().id != 0; }

    /// The structs of the C interface; Status::too_small where an array is shorter than the path.
    static Status raw(const Path &path, const Trace &trace, palpate_path &p, palpate_trace &t) noexcept {
        const std::size_t n = path.times_s.size();
        auto fits = [n](std::size_t size, std::size_t width) { return size == 0 || size >= n * width; };
        if (path.positions_m.size() < 3 * n || !fits(path.orientations.size(), 4) || !fits(trace.forces_n.size(), 3) ||
            !fits(trace.torques_nm.size(), 3) || !fits(trace.flags.size(), 1) || !fits(trace.energies.size(), 1) ||
            !fits(trace.outputs.size(), 1))
            return Status::too_small;
        auto there = [](auto span) { return span.empty() ? nullptr : span.data(); };
        p = palpate_path{static_cast<std::uint32_t>(sizeof p), 0, n, path.times_s.data(), path.positions_m.data(),
                         there(path.orientations)};
        t = palpate_trace{static_cast<std::uint32_t>(sizeof t), 0,
                          there(trace.forces_n),  there(trace.torques_nm), there(trace.flags),
                          there(trace.energies),  there(trace.outputs)};
        return Status::ok;
    }

private:
    detail::Owner<palpate_contact, palpate_contact_close> owner_;
};

#ifndef PALPATE_NO_EXCEPTIONS
/// Leads each contact along its path, on all cores (`threads` 0).
inline void rollout_many(Span<Contact> contacts, Span<const Path> paths, Span<const Trace> traces,
                         std::size_t threads = 0) {
    if (paths.size() != contacts.size() || traces.size() != contacts.size())
        throw Error(Status::invalid, "give one path and one trace for each contact");
    std::vector<palpate_contact> handles(contacts.size());
    std::vector<palpate_path> p(contacts.size());
    std::vector<palpate_trace> t(contacts.size());
    for (std::size_t i = 0; i < contacts.size(); ++i) {
        handles[i] = contacts[i].handle();
        detail::check(Contact::raw(paths[i], traces[i], p[i], t[i]));
    }
    Message message;
    detail::check(detail::status(palpate_rollout_many(handles.data(), p.data(), t.data(), handles.size(), threads, &message)),
                  message);
}
#endif

/// A device of the program's own. read and write are called from the haptic thread: bounded, no allocation. No function throws.
class Device {
public:
    virtual ~Device() = default;
    /// Connects, fills in what it can do, and writes why not to `message` if it fails.
    virtual palpate_fault open(palpate_capabilities &capabilities, Span<char> message) noexcept = 0;
    virtual palpate_fault read(double now_s, palpate_sample &sample) noexcept = 0;
    virtual palpate_fault write(const palpate_command &command) noexcept = 0;
    virtual void close() noexcept = 0;
    /// From any thread; waits for nothing.
    virtual void emergency_stop() noexcept {}

    /// The table of the C interface; the device must live until the session is closed.
    palpate_device table() noexcept {
        palpate_device table = PALPATE_DEVICE_INIT;
        table.user = this;
        table.open = [](void *user, palpate_capabilities *c, char *message, std::size_t bytes) {
            return static_cast<Device *>(user)->open(*c, Span<char>(message, bytes));
        };
        table.read = [](void *user, double now_s, palpate_sample *s) { return static_cast<Device *>(user)->read(now_s, *s); };
        table.write = [](void *user, const palpate_command *c) { return static_cast<Device *>(user)->write(*c); };
        table.close = [](void *user) { static_cast<Device *>(user)->close(); };
        table.emergency_stop = [](void *user) { static_cast<Device *>(user)->emergency_stop(); };
        return table;
    }
};

/// A session: a device on a body. Destroyed, it is stopped and waited for.
class Session {
public:
    Session() noexcept = default;

    static Status try_prepare(const Body &body, const char *config_json, Device *device, Session &session,
                              Message *message = nullptr) noexcept {
        Session made;
        palpate_device table = device ? device->table() : palpate_device{};
        Status s = detail::status(palpate_session_prepare(body.handle(), config_json, device ? &table : nullptr,
                                                          made.owner_.put(), detail::raw(message)));
        if (s == Status::ok) session = std::move(made);
        return s;
    }
    Status try_start(Message *message = nullptr) noexcept {
        return detail::status(palpate_session_start(handle(), detail::raw(message)));
    }
    /// Real-time.
    Status try_latest(Record &record) const noexcept { return detail::status(palpate_session_latest(handle(), &record)); }
    Status try_set_force_limit(double force_max_n, double slew_n_per_s = 0, Message *message = nullptr) noexcept {
        return detail::status(palpate_session_set_force_limit(handle(), force_max_n, slew_n_per_s, detail::raw(message)));
    }
    Status try_set_friction_scale(double scale, Message *message = nullptr) noexcept {
        return detail::status(palpate_session_set_friction_scale(handle(), scale, detail::raw(message)));
    }
    Status try_change_body(const Body &body, Message *message = nullptr) noexcept {
        return detail::status(palpate_session_change_body(handle(), body.handle(), detail::raw(message)));
    }
    Status pause() noexcept { return detail::status(palpate_session_pause(handle())); }
    Status resume() noexcept { return detail::status(palpate_session_resume(handle())); }
    Status stop() noexcept { return detail::status(palpate_session_stop(handle())); }
    Status stop_at_once() noexcept { return detail::status(palpate_session_stop_at_once(handle())); }
    /// Whether it is over within that time.
    bool wait(double timeout_s) const noexcept {
        std::uint32_t is_over = 0;
        return palpate_session_wait(handle(), timeout_s, &is_over) == PALPATE_STATUS_OK && is_over != 0;
    }
    Status try_close(Outcome &outcome, Message *message = nullptr) noexcept {
        Status s = detail::status(palpate_session_close(handle(), &outcome, detail::raw(message)));
        if (s == Status::ok) owner_.release();
        return s;
    }

#ifndef PALPATE_NO_EXCEPTIONS
    Session(const Body &body, const std::string &config_json, Device *device = nullptr) {
        Message message;
        detail::check(try_prepare(body, config_json.c_str(), device, *this, &message), message);
    }
    void start() {
        Message message;
        detail::check(try_start(&message), message);
    }
    /// What could not be had, and what the hand should know, a line each.
    std::string notes() const {
        std::size_t needed = 0;
        palpate_session_notes(handle(), nullptr, 0, &needed);
        std::string text(needed, '\0');
        detail::check(detail::status(palpate_session_notes(handle(), text.data(), text.size(), &needed)));
        text.resize(needed - 1);
        return text;
    }
    Outcome close() {
        Outcome outcome;
        Message message;
        detail::check(try_close(outcome, &message), message);
        return outcome;
    }
#endif

    palpate_session handle() const noexcept { return owner_.get(); }
    explicit operator bool() const noexcept { return handle().id != 0; }

private:
    detail::Owner<palpate_session, detail::close_session> owner_;
};

} // namespace palpate

#endif
