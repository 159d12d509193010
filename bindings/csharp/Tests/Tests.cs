// What the C# binding must do, with the library itself. Arguments: "layouts" prints every struct's size and members' places; "all" and a
// folder runs the rest, and ends with 1 if anything is wrong.

using System;
using System.Collections.Generic;
using System.IO;
using System.Reflection;
using System.Runtime.InteropServices;
using System.Threading;
using Palpate;
using Palpate.Unity;
using UnityEngine;

static class Tests
{
    static int wrong;

    static void Expect(bool holds, string what)
    {
        if (holds) return;
        Console.Error.WriteLine("wrong: " + what);
        wrong++;
    }

    static void Throws(Status status, string words, Action action)
    {
        try
        {
            action();
            Expect(false, status + " " + words + ": nothing was thrown, from " + Environment.StackTrace);
        }
        catch (PalpateException e)
        {
            Expect(e.Status == status && e.Message.Contains(words), status + ", " + words + ": " + e.Status + ", " + e.Message);
        }
    }

    static int Main(string[] arguments)
    {
        if (arguments.Length == 1 && arguments[0] == "layouts")
        {
            Layouts();
            return 0;
        }
        string folder = arguments[1];
        Bodies(folder);
        Contacts();
        Certificates();
        Sessions();
        Scene(folder);
        Console.WriteLine(wrong == 0 ? "all is well" : wrong + " wrong");
        return wrong == 0 ? 0 : 1;
    }

    /// <summary>Every struct of the binding that the C library has, too.</summary>
    static void Layouts()
    {
        foreach (var type in typeof(Body).Assembly.GetTypes())
        {
            if (!type.IsValueType || !type.IsLayoutSequential || type.IsEnum || type.Namespace != "Palpate") continue;
            if (type == typeof(Vec3) || type == typeof(Quat) || type == typeof(Words3)) continue;
            var places = new List<string>();
            foreach (var field in type.GetFields(BindingFlags.Instance | BindingFlags.Public | BindingFlags.NonPublic))
                places.Add(field.Name + " " + Marshal.OffsetOf(type, field.Name));
            Console.WriteLine(type.Name + " " + Marshal.SizeOf(type) + " bytes: " + string.Join(", ", places));
        }
    }

    static Body Ball(double friction = 0.3)
    {
        // An octahedron, divided.
        var positions = new List<Vec3> { V(1, 0, 0), V(-1, 0, 0), V(0, 1, 0), V(0, -1, 0), V(0, 0, 1), V(0, 0, -1) };
        var triangles = new List<int> { 0, 2, 4, 2, 1, 4, 1, 3, 4, 3, 0, 4, 2, 0, 5, 1, 2, 5, 3, 1, 5, 0, 3, 5 };
        for (int round = 0; round < 3; round++)
        {
            var halves = new Dictionary<long, int>();
            var finer = new List<int>();
            for (int t = 0; t < triangles.Count; t += 3)
            {
                int a = triangles[t], b = triangles[t + 1], c = triangles[t + 2];
                int ab = Half(positions, halves, a, b), bc = Half(positions, halves, b, c), ca = Half(positions, halves, c, a);
                finer.AddRange(new[] { a, ab, ca, ab, b, bc, ca, bc, c, ab, bc, ca });
            }
            triangles = finer;
        }
        var flat = new List<double>();
        foreach (var p in positions) flat.AddRange(new[] { 0.03 * p.X, 0.03 * p.Y, 0.03 * p.Z });
        var top = V(0, 0, 0.03);
        SampleRow[] samples =
        {
            new SampleRow { Component = 1, PositionM = top, DeflectionM = 4e-3, Value = 1.0 },
            new SampleRow { Component = 1, PositionM = top, DeflectionM = 8e-3, Value = 3.0 },
            new SampleRow { Component = 2, PositionM = top, DeflectionM = 4e-3, Value = 2.0 },
        };
        return Body.FromArrays(flat.ToArray(), triangles.ConvertAll(k => (uint)k).ToArray(), samples, friction);
    }

    static Vec3 V(double x, double y, double z) { return new Vec3(x, y, z); }

    static int Half(List<Vec3> all, Dictionary<long, int> halves, int a, int b)
    {
        long key = 100000L * Math.Min(a, b) + Math.Max(a, b);
        int k;
        if (halves.TryGetValue(key, out k)) return k;
        var m = V(all[a].X + all[b].X, all[a].Y + all[b].Y, all[a].Z + all[b].Z);
        all.Add(V(m.X / m.Length, m.Y / m.Length, m.Z / m.Length));
        return halves[key] = all.Count - 1;
    }

    static void Bodies(string folder)
    {
        Expect(Library.Version.StartsWith("0.") && Library.Version.Contains("features"), Library.Version);
        Throws(Status.Body, "nowhere.body", () => Body.Open("nowhere.body"));
        Throws(Status.Body, "", () => Body.FromMemory(new byte[] { 1, 2, 3 }));
        Throws(Status.Body, "", () => Body.FromArrays(new double[9], new uint[] { 0, 1, 2 }, new SampleRow[0]));
        using (var ball = Ball())
        {
            var info = ball.Inspect();
            Expect(info.Elements == 512 && info.TestPoints == 1 && info.HasTank == 1, "inspect");
            Expect(Math.Abs(info.StiffnessMaxNPerM - 583.33) < 200 && info.HighM.Z > 0.0299, "inspect's numbers");
            string file = Path.Combine(folder, "bäll.body");
            ball.Save(file);
            using (var again = Body.Open(file)) Expect(again.Inspect().Identity == info.Identity, "saved and opened");
            double[] positions;
            uint[] triangles;
            ball.Surface(out positions, out triangles);
            Expect(triangles.Length == 3 * 512 && positions.Length == 3 * (int)info.Nodes, "surface");
            var closed = Ball();
            closed.Dispose();
            closed.Dispose();
            try
            {
                closed.Inspect();
                Expect(false, "a closed body was inspected");
            }
            catch (ObjectDisposedException) { }
        }
    }

    static void Contacts()
    {
        Contact contact;
        using (var ball = Ball()) contact = new Contact(ball, SlipRule.Exact, 0.5);
        // It keeps its body.
        using (contact)
        {
            contact.Step(V(0, 0, 0.032), 1e-3);
            var output = contact.Step(V(0, 0, 0.026), 1e-3);
            Expect(((StepFlags)output.Flags & StepFlags.InContact) != 0 && Math.Abs(output.ForceN.Z - 1.0) < 0.1, "a step");
            Expect(output.ForceN.Z == contact.Step(V(0, 0, 0.026), 1e-3).ForceN.Z, "held");
            using (var snapshot = contact.Snapshot())
            {
                var ahead = contact.Step(V(0.002, 0, 0.025), 1e-3).ForceN;
                contact.Restore(snapshot);
                Expect(ahead.X == contact.Step(V(0.002, 0, 0.025), 1e-3).ForceN.X, "a snapshot");
            }
            Expect(contact.Counters().Steps > 3 && contact.Ledger().StoredJ > 0, "counters and ledger");
            Expect(((StepFlags)contact.Step(V(double.NaN, 0, 0), 1e-3).Flags & StepFlags.InvalidPose) != 0, "not a number");
            Throws(Status.Invalid, "", () => contact.SetFrictionScale(-1));
            using (var other = Ball(0.2))
            using (var stranger = new Contact(other)) Throws(Status.OtherBody, "", () => contact.Restore(stranger));
        }
        try
        {
            contact.Step(V(0, 0, 0), 1e-3);
            Expect(false, "a closed contact was stepped");
        }
        catch (ObjectDisposedException) { }
    }

    static void Certificates()
    {
        using (var ball = Ball())
        {
            var touch = Body.Device("touch");
            var found = ball.Certify(touch, SlipRule.Paper, evaluations: 20, threads: 1);
            ulong counted = found.PassiveProvedElements + found.PassiveFailingElements + found.PassiveUndecidedElements;
            Expect(found.Elements == 512 && counted == 512 && found.SlipRule == 1, "a certificate");
            Throws(Status.Cancelled, "", () => ball.Certify(progress: (done, of, words) => done < 3));
            try
            {
                ball.Certify(progress: (done, of, words) => { throw new DivideByZeroException(); });
                Expect(false, "a progress function's exception was lost");
            }
            catch (InvalidOperationException e) { Expect(e.InnerException is DivideByZeroException, "the exception"); }
            Throws(Status.Invalid, "falcon", () => Body.Device("wand"));
        }
    }

    const string Quiet = "{\"device\": \"simulated:touch\", \"motion\": \"press\", \"seconds\": 0.5, " +
                         "\"safety\": {\"silence_s\": 5, \"soft_start_s\": 0.05}, \"patience\": {\"late_s\": 10, \"finder_s\": 60, \"pose_s\": 10}, " +
                         "\"real_time\": {\"priority\": 0, \"core\": -1, \"lock_memory\": false, \"spin_s\": 0}}";

    static void Sessions()
    {
        using (var ball = Ball())
        {
            Throws(Status.Invalid, "colour", () => new Session(ball, "{\"colour\": 1}"));
            Throws(Status.Session, "", () => new Session(ball, "{\"rate_hz\": 1}"));
            var session = new Session(ball, Quiet);
            Record record;
            Expect(!session.TryLatest(out record) && session.Notes != null, "nothing before the start");
            session.Start();
            session.SetFrictionScale(0.5);
            Expect(session.Wait(30) && session.TryLatest(out record) && record.Number > 0, "it ran");
            Expect(session.History().Length > 5 && session.Summary.Contains("periods"), "history and summary");
            var outcome = session.Close();
            Expect(outcome.IsWell && outcome.End == End.Done && outcome.Periods > 100, outcome.Words + " " + outcome.Periods);
            session.Dispose();
            using (var other = new Session(ball, Quiet.Replace("0.5, ", "600, ")))
            {
                other.Start();
                Thread.Sleep(20);
            }
        }
        // A handle that nobody closed is the garbage collector's.
        new Session(Ball(), Quiet).Start();
        GC.Collect();
        GC.WaitForPendingFinalizers();
    }

    /// <summary>The components, in a scene with a turned and moved body.</summary>
    static void Scene(string folder)
    {
        string file = Path.Combine(folder, "scene.body");
        using (var ball = Ball()) ball.Save(file);
        var liver = new GameObject();
        liver.transform.position = new Vector3(1, 2, 3);
        liver.transform.rotation = new Quaternion(0, 0.6f, 0, 0.8f);
        var filter = liver.AddComponent<MeshFilter>();
        var body = liver.AddComponent<PalpateBody>();
        body.asset = new TextAsset { bytes = File.ReadAllBytes(file) };
        liver.Send("Awake");
        var mesh = filter.mesh;
        // A front face is clockwise from outside: with left-handed axes the cross product points to where it is seen from.
        int outwards = 0;
        for (int t = 0; t < mesh.triangles.Length; t += 3)
        {
            Vector3 a = mesh.vertices[mesh.triangles[t]], b = mesh.vertices[mesh.triangles[t + 1]], c = mesh.vertices[mesh.triangles[t + 2]];
            if (Vector3.Dot(Vector3.Cross(b - a, c - a), a + b + c) > 0) outwards++;
        }
        Expect(outwards == 512, outwards + " of 512 triangles face outwards");

        var probe = new GameObject();
        var tool = probe.AddComponent<PalpateTool>();
        probe.AddComponent<PalpateSample>();
        tool.touched = body;
        probe.transform.position = liver.transform.position + new Vector3(0, 0.032f, 0);
        probe.Send("Start");
        float most = 0;
        for (int frame = 0; frame < 100; frame++)
        {
            probe.Send("FixedUpdate");
            if (tool.Force.y > most) most = tool.Force.y;
        }
        Expect(tool.IsTouching && most > 0.5f, "the tool feels " + most + " N upwards");
        Expect(Math.Abs(tool.ContactPoint.y - 2.03f) < 0.005f, "the contact point");
        Expect(Debug.said.Contains("touched"), "what the sample says");
        probe.Send("OnDisable");
        Expect(!tool.IsTouching && tool.Force.y == 0, "disabled");

        var hand = new GameObject();
        var haptics = hand.AddComponent<PalpateHaptics>();
        haptics.touched = body;
        haptics.settings = Quiet;
        // As Unity does: enabled first, before the others have started.
        hand.Send("OnEnable");
        Expect(haptics.Session == null, "no session before the start");
        hand.Send("Start");
        RunToItsEnd(hand, haptics);
        hand.Send("OnDisable");
        hand.Send("OnEnable");
        Expect(haptics.Session != null && haptics.Outcome == null, "enabled again it begins another session");
        hand.Send("OnEnable");
        RunToItsEnd(hand, haptics);
        hand.Send("OnEnable");
        hand.Send("OnDisable");
        Expect(haptics.Session == null && haptics.Outcome != null, "disabled");
        liver.Send("OnDestroy");
        Expect(body.Body == null, "destroyed");
    }

    static void RunToItsEnd(GameObject hand, PalpateHaptics haptics)
    {
        for (int frame = 0; frame < 3000 && haptics.Outcome == null; frame++)
        {
            hand.Send("Update");
            Thread.Sleep(20);
        }
        Expect(haptics.Outcome != null && haptics.Outcome.IsWell && haptics.Latest.Number > 100, "the haptics component");
    }
}
