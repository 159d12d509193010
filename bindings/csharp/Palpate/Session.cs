using System;
using System.Runtime.InteropServices;

namespace Palpate
{
    /// <summary>Why a session ended; as PALPATE_END_... in palpate.h.</summary>
    public enum End : uint
    {
        NeverStarted = 0, Done = 1, Ended = 2, Asked = 3, Emergency = 4, Device = 5, Stale = 6, Late = 7, FinderSilent = 8,
        Body = 9, FinderDead = 10, Panic = 11,
    }

    /// <summary>What became of a session.</summary>
    public sealed class Outcome
    {
        internal Outcome(NativeOutcome native)
        {
            End = (End)native.End;
            IsWell = native.IsWell != 0;
            Periods = native.Periods;
            Recorded = native.Recorded;
            ForceMaxN = native.ForceMaxN;
            Words = Native.Text(native.Message);
        }
        public End End { get; private set; }
        /// <summary>Whether it went as it should.</summary>
        public bool IsWell { get; private set; }
        public ulong Periods { get; private set; }
        /// <summary>Records that were written to the file.</summary>
        public ulong Recorded { get; private set; }
        /// <summary>The largest force that was commanded, N.</summary>
        public double ForceMaxN { get; private set; }
        /// <summary>Why it ended.</summary>
        public string Words { get; private set; }
    }

    /// <summary>A device on a body, with its own threads, limits and watchdogs (docs/session.md). The haptic thread is the
    /// library's, and no garbage collector stops it. docs/safety.md holds.</summary>
    public sealed class Session : IDisposable
    {
        readonly SessionHandle handle = new SessionHandle();

        /// <summary>Opens the device and starts nothing: no force before Start.</summary>
        /// <param name="settingsJson">Settings of docs/session.md as a JSON object; null for the defaults, a simulated device.</param>
        public Session(Body body, string settingsJson = null)
        {
            ulong id;
            var error = Native.NewError();
            int status = Native.palpate_session_prepare(body.Handle, Native.Utf8(settingsJson), IntPtr.Zero, out id, ref error);
            Native.Check(status, ref error);
            handle.Take(id);
        }

        /// <summary>From now on there are forces.</summary>
        public void Start()
        {
            var error = Native.NewError();
            Native.Check(Native.palpate_session_start(handle, ref error), ref error);
        }

        delegate int Give(SessionHandle session, byte[] buffer, UIntPtr capacity, out UIntPtr needed);

        string Text(Give give)
        {
            var buffer = new byte[4096];
            while (true)
            {
                UIntPtr needed;
                int status = give(handle, buffer, (UIntPtr)buffer.Length, out needed);
                if (status != (int)Status.TooSmall)
                {
                    Native.Check(status);
                    return Native.Text(buffer);
                }
                buffer = new byte[(int)needed];
            }
        }

        /// <summary>What could not be had (a watchdog, locked memory, a priority), a line each: known before the first force.</summary>
        public string Notes { get { return Text(Native.palpate_session_notes); } }

        /// <summary>Statistics so far, as JSON.</summary>
        public string Summary { get { return Text(Native.palpate_session_summary); } }

        static readonly uint RecordBytes = Native.SizeOf<Record>();

        /// <summary>The latest period; false before the first. It allocates nothing, and the haptic thread does not notice.</summary>
        public bool TryLatest(out Record record)
        {
            record = new Record { StructSize = RecordBytes };
            int status = Native.palpate_session_latest(handle, ref record);
            if (status == (int)Status.Nothing || status == (int)Status.Busy) return false;
            if (status != 0) Native.Check(status);
            return true;
        }

        /// <summary>Periods of the past, as many a second as the setting "history" says, the oldest first.</summary>
        public Record[] History()
        {
            UIntPtr count;
            Native.palpate_session_history(handle, null, UIntPtr.Zero, out count);
            // Some more, since it goes on.
            var records = new Record[(int)count + 16];
            int status = Native.palpate_session_history(handle, records, (UIntPtr)records.Length, out count);
            if (status != (int)Status.TooSmall) Native.Check(status);
            Array.Resize(ref records, Math.Min(records.Length, (int)count));
            return records;
        }

        /// <summary>The largest force, N, and how fast it may change, N/s; 0 for the slowest that lets a stop end in two periods.</summary>
        public void SetForceLimit(double forceMaxN, double slewNPerS = 0)
        {
            var error = Native.NewError();
            Native.Check(Native.palpate_session_set_force_limit(handle, forceMaxN, slewNPerS, ref error), ref error);
        }

        /// <summary>The largest torque, N m, and how fast it may change, N m/s.</summary>
        public void SetTorqueLimit(double torqueMaxNm, double slewNmPerS = 0)
        {
            var error = Native.NewError();
            Native.Check(Native.palpate_session_set_torque_limit(handle, torqueMaxNm, slewNmPerS, ref error), ref error);
        }

        /// <summary>What multiplies the body's friction coefficients, 0 to 100.</summary>
        public void SetFrictionScale(double scale)
        {
            var error = Native.NewError();
            Native.Check(Native.palpate_session_set_friction_scale(handle, scale, ref error), ref error);
        }

        /// <summary>Goes over to another slip rule.</summary>
        public void SetSlipRule(SlipRule rule)
        {
            var error = Native.NewError();
            Native.Check(Native.palpate_session_set_slip_rule(handle, (uint)rule, ref error), ref error);
        }

        /// <summary>Goes over to another body; not while a recording is written.</summary>
        public void ChangeBody(Body body)
        {
            var error = Native.NewError();
            Native.Check(Native.palpate_session_change_body(handle, body.Handle, ref error), ref error);
        }

        /// <summary>No force, until Resume.</summary>
        public void Pause() { Native.Check(Native.palpate_session_pause(handle)); }

        /// <summary>Ends a pause: the force ramps up anew.</summary>
        public void Resume() { Native.Check(Native.palpate_session_resume(handle)); }

        /// <summary>Asks for the end, and waits for nothing.</summary>
        public void Stop() { Native.Check(Native.palpate_session_stop(handle)); }

        /// <summary>The same with zero force before anything else, by the device's own emergency stop.</summary>
        public void StopAtOnce() { Native.Check(Native.palpate_session_stop_at_once(handle)); }

        /// <summary>Waits until it is over by itself, or for so long, s. Whether it is over.</summary>
        public bool Wait(double timeoutS)
        {
            uint isOver;
            Native.Check(Native.palpate_session_wait(handle, timeoutS, out isOver));
            return isOver != 0;
        }

        /// <summary>Ends it, waits for its threads and its recording, and tells what became of it.</summary>
        public Outcome Close()
        {
            if (handle.IsClosed || handle.IsInvalid) throw new ObjectDisposedException("Session");
            var outcome = new NativeOutcome { StructSize = Native.SizeOf<NativeOutcome>(), Message = new byte[512] };
            IntPtr place = Marshal.AllocHGlobal(Marshal.SizeOf(typeof(NativeOutcome)));
            try
            {
                Marshal.StructureToPtr(outcome, place, false);
                Native.Check(Native.palpate_session_close(handle.DangerousGetHandle(), place, IntPtr.Zero));
                handle.SetHandleAsInvalid();
                return new Outcome((NativeOutcome)Marshal.PtrToStructure(place, typeof(NativeOutcome)));
            }
            finally
            {
                Marshal.FreeHGlobal(place);
            }
        }

        /// <summary>Ends it.</summary>
        public void Dispose() { handle.Dispose(); }
    }
}
