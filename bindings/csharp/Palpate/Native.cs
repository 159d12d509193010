// The functions of palpate.h. A handle there is a struct of one 64-bit number, which 64-bit machines pass as a pointer is passed: a
// SafeHandle stands for it, and keeps it open as long as a call lasts. 32-bit processes are refused.

using System;
using System.Runtime.InteropServices;
using System.Text;

namespace Palpate
{
    /// <summary>The name by which Unity's IL2CPP knows functions that native code calls.</summary>
    [AttributeUsage(AttributeTargets.Method)]
    internal sealed class MonoPInvokeCallbackAttribute : Attribute
    {
        public MonoPInvokeCallbackAttribute(Type type) { Type = type; }
        public Type Type { get; private set; }
    }

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    internal delegate int ProgressFunction(IntPtr user, IntPtr progress);

    /// <summary>A handle that is closed once, when nobody is in a call with it.</summary>
    public abstract class Handle : SafeHandle
    {
        internal Handle() : base(IntPtr.Zero, true) { }
        /// <summary>Whether it is of nothing.</summary>
        public override bool IsInvalid { get { return handle == IntPtr.Zero; } }
        internal void Take(ulong id) { SetHandle(unchecked((IntPtr)(long)id)); }
    }

    internal sealed class BodyHandle : Handle
    {
        protected override bool ReleaseHandle() { return Native.palpate_body_close(handle) == 0; }
    }

    internal sealed class ContactHandle : Handle
    {
        protected override bool ReleaseHandle() { return Native.palpate_contact_close(handle) == 0; }
    }

    internal sealed class SessionHandle : Handle
    {
        protected override bool ReleaseHandle()
        {
            return Native.palpate_session_close(handle, IntPtr.Zero, IntPtr.Zero) == 0;
        }
    }

    internal static class Native
    {
        const string Library = "palpate";
        const CallingConvention C = CallingConvention.Cdecl;

        /// <summary>PALPATE_ABI_VERSION of the header that this was written for.</summary>
        internal const uint AbiVersion = 2;

        static Native()
        {
            if (IntPtr.Size != 8) throw new PlatformNotSupportedException("palpate runs in 64-bit processes only");
            Check(palpate_check_abi(AbiVersion));
        }

        [DllImport(Library, CallingConvention = C)] internal static extern uint palpate_abi_version();
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_check_abi(uint abi_version);
        [DllImport(Library, CallingConvention = C)] internal static extern IntPtr palpate_version();
        [DllImport(Library, CallingConvention = C)] internal static extern uint palpate_features();
        [DllImport(Library, CallingConvention = C)] internal static extern IntPtr palpate_status_text(int status);

        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_body_open(byte[] path, out ulong body, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_body_from_memory(byte[] bytes, UIntPtr length, out ulong body, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_body_from_arrays(ref NativeBodyArrays arrays, out ulong body, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_body_from_spec(byte[] spec_path, byte[] work_folder, uint threads, ProgressFunction progress, IntPtr user, out ulong body, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_body_save(BodyHandle body, byte[] path, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_body_inspect(BodyHandle body, ref BodyInfo info);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_body_stiffness(BodyHandle body, double[] depths_m, double[] stiffness_n_per_m, UIntPtr capacity, out UIntPtr count);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_body_surface(BodyHandle body, double[] positions_m, UIntPtr node_capacity, uint[] triangles, UIntPtr element_capacity);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_body_certify(BodyHandle body, ref NativeCertifyOptions options, ProgressFunction progress, IntPtr user, ref Certificate certificate, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_body_close(IntPtr body);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_loop_device_of(byte[] name, double rate_hz, ref LoopDevice device, ref NativeError error);

        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_create(BodyHandle body, ref NativeContactOptions options, out ulong contact, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_step(ContactHandle contact, ref ToolState tool, double dt_s, ref Output output);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_snapshot(ContactHandle contact, out ulong snapshot);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_restore(ContactHandle contact, ContactHandle snapshot);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_forget(ContactHandle contact);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_ledger(ContactHandle contact, ref Ledger ledger);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_counters(ContactHandle contact, ref Counters counters);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_set_friction_scale(ContactHandle contact, double scale);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_set_slip_rule(ContactHandle contact, uint rule);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_set_tank(ContactHandle contact, uint tank);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_set_partial_slip(ContactHandle contact, uint partial_slip);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_rollout(ContactHandle contact, ref NativePath path, ref NativeTrace trace, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_rollout_many(ulong[] contacts, NativePath[] paths, [In, Out] NativeTrace[] traces, UIntPtr count, UIntPtr threads, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_contact_close(IntPtr contact);

        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_prepare(BodyHandle body, byte[] config_json, IntPtr device, out ulong session, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_start(SessionHandle session, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_notes(SessionHandle session, byte[] buffer, UIntPtr capacity, out UIntPtr needed);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_latest(SessionHandle session, ref Record record);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_history(SessionHandle session, [In, Out] Record[] records, UIntPtr capacity, out UIntPtr count);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_summary(SessionHandle session, byte[] buffer, UIntPtr capacity, out UIntPtr needed);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_set_force_limit(SessionHandle session, double force_max_n, double slew_n_per_s, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_set_torque_limit(SessionHandle session, double torque_max_nm, double slew_nm_per_s, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_set_friction_scale(SessionHandle session, double scale, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_set_slip_rule(SessionHandle session, uint rule, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_change_body(SessionHandle session, BodyHandle body, ref NativeError error);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_pause(SessionHandle session);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_resume(SessionHandle session);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_stop(SessionHandle session);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_stop_at_once(SessionHandle session);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_wait(SessionHandle session, double timeout_s, out uint is_over);
        [DllImport(Library, CallingConvention = C)] internal static extern int palpate_session_close(IntPtr session, IntPtr outcome, IntPtr error);

        internal static NativeError NewError()
        {
            return new NativeError { StructSize = SizeOf<NativeError>(), Message = new byte[1016] };
        }

        internal static uint SizeOf<T>() { return (uint)Marshal.SizeOf(typeof(T)); }

        /// <summary>UTF-8 with the zero that ends it.</summary>
        internal static byte[] Utf8(string text)
        {
            return text == null ? null : Encoding.UTF8.GetBytes(text + "\0");
        }

        internal static string Text(byte[] bytes)
        {
            int end = Array.IndexOf(bytes, (byte)0);
            return Encoding.UTF8.GetString(bytes, 0, end < 0 ? bytes.Length : end);
        }

        internal static string Text(IntPtr text)
        {
            if (text == IntPtr.Zero) return null;
            int length = 0;
            while (Marshal.ReadByte(text, length) != 0) length++;
            var bytes = new byte[length];
            Marshal.Copy(text, bytes, 0, length);
            return Encoding.UTF8.GetString(bytes);
        }

        internal static void Check(int status)
        {
            if (status != 0) throw new PalpateException((Status)status, Text(palpate_status_text(status)));
        }

        internal static void Check(int status, ref NativeError error)
        {
            if (status == 0) return;
            string message = Text(error.Message);
            throw new PalpateException((Status)status, message.Length > 0 ? message : Text(palpate_status_text(status)));
        }
    }

    /// <summary>Progress of long work, led from the library's threads to a C# function.</summary>
    internal sealed class Listener : IDisposable
    {
        static readonly ProgressFunction told = Told;
        readonly Func<ulong, ulong, string, bool> function;
        GCHandle self;
        Exception thrown;

        internal Listener(Func<ulong, ulong, string, bool> function)
        {
            this.function = function;
            self = GCHandle.Alloc(this);
        }

        internal ProgressFunction Function { get { return function == null ? null : told; } }
        internal IntPtr User { get { return GCHandle.ToIntPtr(self); } }

        [MonoPInvokeCallback(typeof(ProgressFunction))]
        static int Told(IntPtr user, IntPtr progress)
        {
            var listener = (Listener)GCHandle.FromIntPtr(user).Target;
            try
            {
                var p = (NativeProgress)Marshal.PtrToStructure(progress, typeof(NativeProgress));
                return listener.function(p.PointsDone, p.Points, Native.Text(p.Message)) ? 0 : 1;
            }
            catch (Exception e)
            {
                // No exception may pass through the library: the work ends, and it is thrown again where the work was asked for.
                listener.thrown = e;
                return 1;
            }
        }

        internal void Check(int status, ref NativeError error)
        {
            if (thrown != null) throw new InvalidOperationException("the progress function failed", thrown);
            Native.Check(status, ref error);
        }

        public void Dispose() { self.Free(); }
    }

    /// <summary>Arrays that stay where they are during a call.</summary>
    internal sealed class Pins : IDisposable
    {
        readonly System.Collections.Generic.List<GCHandle> all = new System.Collections.Generic.List<GCHandle>();

        internal IntPtr Of(Array array)
        {
            if (array == null) return IntPtr.Zero;
            var pin = GCHandle.Alloc(array, GCHandleType.Pinned);
            all.Add(pin);
            return pin.AddrOfPinnedObject();
        }

        public void Dispose()
        {
            foreach (var pin in all) pin.Free();
            all.Clear();
        }
    }
}
