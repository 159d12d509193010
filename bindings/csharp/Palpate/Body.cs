using System;

namespace Palpate
{
    /// <summary>A soft body at rest: read-only, shared by any number of contacts and threads. Lengths in m, in its own frame,
    /// which is right-handed.</summary>
    public sealed class Body : IDisposable
    {
        internal readonly BodyHandle Handle = new BodyHandle();

        Body(ulong id) { Handle.Take(id); }

        /// <summary>Opens a body file.</summary>
        /// <exception cref="PalpateException">It can't be read, or is damaged.</exception>
        public static Body Open(string path)
        {
            ulong id;
            var error = Native.NewError();
            Native.Check(Native.palpate_body_open(Native.Utf8(path), out id, ref error), ref error);
            return new Body(id);
        }

        /// <summary>The same from the bytes of a body file, such as a text asset's.</summary>
        public static Body FromMemory(byte[] bytes)
        {
            ulong id;
            var error = Native.NewError();
            int status = Native.palpate_body_from_memory(bytes, (UIntPtr)bytes.Length, out id, ref error);
            Native.Check(status, ref error);
            return new Body(id);
        }

        /// <summary>Makes a body of a surface and measured values.</summary>
        /// <param name="positionsM">Vertices, x y z each, m.</param>
        /// <param name="triangles">Three vertices each, counter-clockwise seen from outside.</param>
        /// <param name="samples">Measured values.</param>
        /// <param name="friction">The coefficient where no sample gives one; negative for none.</param>
        /// <param name="toolRadiusM">Radius of the spherical tool, m; 0 for a tip.</param>
        public static Body FromArrays(double[] positionsM, uint[] triangles, SampleRow[] samples, double friction = -1,
                                      double toolRadiusM = 0, SlipRule rule = SlipRule.OfTheBody, bool tank = true)
        {
            using (var pins = new Pins())
            {
                var arrays = new NativeBodyArrays
                {
                    StructSize = Native.SizeOf<NativeBodyArrays>(),
                    AbiVersion = Native.AbiVersion,
                    PositionsM = pins.Of(positionsM),
                    VertexCount = (UIntPtr)(positionsM.Length / 3),
                    Triangles = pins.Of(triangles),
                    TriangleCount = (UIntPtr)(triangles.Length / 3),
                    Samples = pins.Of(samples),
                    SampleCount = (UIntPtr)samples.Length,
                    SampleSize = Native.SizeOf<SampleRow>(),
                    DefaultFriction = friction,
                    ToolRadiusM = toolRadiusM,
                    SlipRule = (uint)rule,
                    WithoutTank = tank ? 0u : 1u,
                };
                ulong id;
                var error = Native.NewError();
                Native.Check(Native.palpate_body_from_arrays(ref arrays, out id, ref error), ref error);
                return new Body(id);
            }
        }

        /// <summary>Makes a body from a spec (docs/spec.md), from seconds to hours.</summary>
        /// <param name="progress">Hears done, of how many, and a message or null; false ends it. Called from the library's
        /// threads.</param>
        public static Body FromSpec(string path, string workFolder = null, uint threads = 0,
                                    Func<ulong, ulong, string, bool> progress = null)
        {
            using (var listener = new Listener(progress))
            {
                ulong id;
                var error = Native.NewError();
                int status = Native.palpate_body_from_spec(Native.Utf8(path), Native.Utf8(workFolder), threads,
                                                           listener.Function, listener.User, out id, ref error);
                listener.Check(status, ref error);
                return new Body(id);
            }
        }

        /// <summary>Writes it to a file.</summary>
        public void Save(string path)
        {
            var error = Native.NewError();
            Native.Check(Native.palpate_body_save(Handle, Native.Utf8(path), ref error), ref error);
        }

        /// <summary>Sizes, law, tool, box, stiffness.</summary>
        public BodyInfo Inspect()
        {
            var info = new BodyInfo { StructSize = Native.SizeOf<BodyInfo>() };
            Native.Check(Native.palpate_body_inspect(Handle, ref info));
            return info;
        }

        /// <summary>The surface at rest: nodes' places (x y z each, m) and triangles, counter-clockwise seen from outside.</summary>
        public void Surface(out double[] positionsM, out uint[] triangles)
        {
            var info = Inspect();
            positionsM = new double[3 * (int)info.Nodes];
            triangles = new uint[3 * (int)info.Elements];
            Native.Check(Native.palpate_body_surface(Handle, positionsM, (UIntPtr)info.Nodes, triangles,
                                                     (UIntPtr)info.Elements));
        }

        /// <summary>Proves that it is passive and free of snaps, or shows where it is not. Seconds to hours.</summary>
        /// <param name="device">The device whose sampled loop is judged, too; null for none.</param>
        public Certificate Certify(LoopDevice? device = null, SlipRule rule = SlipRule.OfTheBody, double stepM = 1e-3,
                                   double depthM = 0, uint evaluations = 0, uint threads = 0,
                                   Func<ulong, ulong, string, bool> progress = null)
        {
            using (var pins = new Pins())
            using (var listener = new Listener(progress))
            {
                var options = new NativeCertifyOptions
                {
                    StructSize = Native.SizeOf<NativeCertifyOptions>(),
                    SlipRule = (uint)rule,
                    Evaluations = evaluations,
                    Threads = threads,
                    StepM = stepM,
                    DepthM = depthM,
                };
                if (device.HasValue)
                {
                    var one = new[] { device.Value };
                    one[0].StructSize = Native.SizeOf<LoopDevice>();
                    options.Device = pins.Of(one);
                }
                var certificate = new Certificate { StructSize = Native.SizeOf<Certificate>() };
                var error = Native.NewError();
                int status = Native.palpate_body_certify(Handle, ref options, listener.Function, listener.User,
                                                         ref certificate, ref error);
                listener.Check(status, ref error);
                return certificate;
            }
        }

        /// <summary>What is known, or guessed, of a device by its name ("touch", "omega", "falcon" and so on).</summary>
        public static LoopDevice Device(string name, double rateHz = 1000)
        {
            var device = new LoopDevice { StructSize = Native.SizeOf<LoopDevice>() };
            var error = Native.NewError();
            Native.Check(Native.palpate_loop_device_of(Native.Utf8(name), rateHz, ref device, ref error), ref error);
            return device;
        }

        /// <summary>Closes it. Contacts and sessions keep it as long as they need it.</summary>
        public void Dispose() { Handle.Dispose(); }
    }
}
