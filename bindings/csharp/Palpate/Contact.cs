using System;

namespace Palpate
{
    /// <summary>A contact: all that evolves while one tool touches one body. One thread at a time.</summary>
    public sealed class Contact : IDisposable
    {
        internal readonly ContactHandle Handle = new ContactHandle();

        Contact(ulong id) { Handle.Take(id); }

        /// <param name="rule">In place of the body's own.</param>
        /// <param name="frictionScale">What the body's friction coefficients are multiplied by.</param>
        public Contact(Body body, SlipRule rule = SlipRule.OfTheBody, double frictionScale = 1)
        {
            var options = new NativeContactOptions
            {
                StructSize = Native.SizeOf<NativeContactOptions>(),
                AbiVersion = Native.AbiVersion,
                SlipRule = (uint)rule,
                FrictionScale = frictionScale,
            };
            ulong id;
            var error = Native.NewError();
            Native.Check(Native.palpate_contact_create(body.Handle, ref options, out id, ref error), ref error);
            Handle.Take(id);
        }

        static readonly uint ToolStateBytes = Native.SizeOf<ToolState>();
        static readonly uint OutputBytes = Native.SizeOf<Output>();

        /// <summary>One sample: where the tool is, in the body's frame, m, and how long after the last one, s. The force is on the
        /// tool, N. It allocates nothing; a pose that can't be used gives no force and a flag.</summary>
        public Output Step(Vec3 positionM, double dtS) { return Step(positionM, Quat.Identity, dtS); }

        /// <summary>The same with the tool's orientation, body from tool.</summary>
        public Output Step(Vec3 positionM, Quat orientation, double dtS)
        {
            var tool = new ToolState { StructSize = ToolStateBytes, PositionM = positionM, Orientation = orientation };
            var output = new Output { StructSize = OutputBytes };
            int status = Native.palpate_contact_step(Handle, ref tool, dtS, ref output);
            if (status != 0) Native.Check(status);
            return output;
        }

        /// <summary>Leads it along a path: the same bits as step after step.</summary>
        /// <param name="timesS">Times, s (n).</param>
        /// <param name="positionsM">Places, x y z each, m (3 n).</param>
        /// <param name="forcesN">Gets forces on the tool, x y z each, N (3 n).</param>
        /// <param name="orientations">w x y z each (4 n), or null.</param>
        /// <param name="torquesNm">Gets torques, x y z each, N m (3 n), or null.</param>
        /// <param name="flags">Gets what happened (n), or null.</param>
        public void Rollout(double[] timesS, double[] positionsM, double[] forcesN, double[] orientations = null,
                            double[] torquesNm = null, uint[] flags = null)
        {
            using (var pins = new Pins())
            {
                var path = PathOf(pins, timesS, positionsM, orientations);
                var trace = TraceOf(pins, timesS.Length, forcesN, torquesNm, flags);
                var error = Native.NewError();
                Native.Check(Native.palpate_contact_rollout(Handle, ref path, ref trace, ref error), ref error);
            }
        }

        /// <summary>Leads many contacts along one path each, on all cores.</summary>
        /// <param name="threads">0 for one on each core.</param>
        public static void RolloutMany(Contact[] contacts, double[][] timesS, double[][] positionsM, double[][] forcesN,
                                       double[][] torquesNm = null, int threads = 0)
        {
            if (timesS.Length != contacts.Length || positionsM.Length != contacts.Length || forcesN.Length != contacts.Length ||
                torquesNm != null && torquesNm.Length != contacts.Length)
                throw new ArgumentException("give as many paths and forces as contacts");
            var ids = new ulong[contacts.Length];
            var held = new bool[contacts.Length];
            try
            {
                using (var pins = new Pins())
                {
                    var paths = new NativePath[contacts.Length];
                    var traces = new NativeTrace[contacts.Length];
                    for (int k = 0; k < contacts.Length; k++)
                    {
                        contacts[k].Handle.DangerousAddRef(ref held[k]);
                        ids[k] = unchecked((ulong)(long)contacts[k].Handle.DangerousGetHandle());
                        paths[k] = PathOf(pins, timesS[k], positionsM[k], null);
                        double[] torques = torquesNm == null ? null : torquesNm[k];
                        traces[k] = TraceOf(pins, timesS[k].Length, forcesN[k], torques, null);
                    }
                    var error = Native.NewError();
                    int status = Native.palpate_rollout_many(ids, paths, traces, (UIntPtr)contacts.Length, (UIntPtr)threads, ref error);
                    Native.Check(status, ref error);
                }
            }
            finally
            {
                for (int k = 0; k < contacts.Length; k++)
                    if (held[k]) contacts[k].Handle.DangerousRelease();
            }
        }

        static NativePath PathOf(Pins pins, double[] timesS, double[] positionsM, double[] orientations)
        {
            if (positionsM.Length != 3 * timesS.Length || orientations != null && orientations.Length != 4 * timesS.Length)
                throw new ArgumentException("give three numbers of a place, and four of an orientation, for each time");
            return new NativePath
            {
                StructSize = Native.SizeOf<NativePath>(),
                Count = (UIntPtr)timesS.Length,
                TimesS = pins.Of(timesS),
                PositionsM = pins.Of(positionsM),
                Orientations = pins.Of(orientations),
            };
        }

        static NativeTrace TraceOf(Pins pins, int count, double[] forcesN, double[] torquesNm, uint[] flags)
        {
            if (forcesN != null && forcesN.Length < 3 * count || torquesNm != null && torquesNm.Length < 3 * count ||
                flags != null && flags.Length < count)
                throw new ArgumentException("an array for results is shorter than the path");
            return new NativeTrace
            {
                StructSize = Native.SizeOf<NativeTrace>(),
                ForcesN = pins.Of(forcesN),
                TorquesNm = pins.Of(torquesNm),
                Flags = pins.Of(flags),
            };
        }

        /// <summary>A contact of its own in the same state, to look ahead with or to go back to.</summary>
        public Contact Snapshot()
        {
            ulong id;
            Native.Check(Native.palpate_contact_snapshot(Handle, out id));
            return new Contact(id);
        }

        /// <summary>Goes back to a snapshot, of this contact or another one on the same body.</summary>
        public void Restore(Contact snapshot) { Native.Check(Native.palpate_contact_restore(Handle, snapshot.Handle)); }

        /// <summary>Forgets where the tool was: the next pose counts as the first one.</summary>
        public void Forget() { Native.Check(Native.palpate_contact_forget(Handle)); }

        /// <summary>Its energies, J.</summary>
        public Ledger Ledger()
        {
            var ledger = new Ledger { StructSize = Native.SizeOf<Ledger>() };
            Native.Check(Native.palpate_contact_ledger(Handle, ref ledger));
            return ledger;
        }

        /// <summary>How often things happened.</summary>
        public Counters Counters()
        {
            var counters = new Counters { StructSize = Native.SizeOf<Counters>() };
            Native.Check(Native.palpate_contact_counters(Handle, ref counters));
            return counters;
        }

        /// <summary>What the body's friction coefficients are multiplied by, from the next step on.</summary>
        public void SetFrictionScale(double scale) { Native.Check(Native.palpate_contact_set_friction_scale(Handle, scale)); }

        /// <summary>Goes over to another slip rule.</summary>
        public void SetSlipRule(SlipRule rule) { Native.Check(Native.palpate_contact_set_slip_rule(Handle, (uint)rule)); }

        /// <summary>Whether slip is kept from giving out more energy than it has dissipated before.</summary>
        public void SetTank(bool tank) { Native.Check(Native.palpate_contact_set_tank(Handle, tank ? 1u : 0u)); }

        /// <summary>Whether there are two contact points side by side, as partial slip wants them, or one. Switch it in free space: in touch force and ledger may step.</summary>
        public void SetPartialSlip(bool partialSlip) { Native.Check(Native.palpate_contact_set_partial_slip(Handle, partialSlip ? 1u : 0u)); }

        /// <summary>Closes it.</summary>
        public void Dispose() { Handle.Dispose(); }
    }
}
