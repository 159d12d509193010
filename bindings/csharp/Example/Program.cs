// Steps along a path on a body, three ways, and prints every force and torque in bits: pose by pose, as a rollout, and as one of several on
// all cores. Arguments: the body's file, and a file of doubles, time x y z and three that are not read. Without arguments it makes a small
// body, presses into it, and prints the force.

using System;
using System.IO;
using System.Text;
using Palpate;

static class Program
{
    static int Main(string[] arguments)
    {
        try
        {
            if (arguments.Length == 2) SamePath(arguments[0], arguments[1]);
            else OwnLoop();
            return 0;
        }
        catch (PalpateException e)
        {
            Console.Error.WriteLine(e.Message);
            return 1;
        }
    }

    /// <summary>A cube with 10 cm edges, measured at one point, pressed from above.</summary>
    static void OwnLoop()
    {
        const double h = 0.05;
        double[] positions = { -h, -h, -h, h, -h, -h, h, h, -h, -h, h, -h, -h, -h, h, h, -h, h, h, h, h, -h, h, h };
        uint[] triangles =
        {
            0, 2, 1, 0, 3, 2, 4, 5, 6, 4, 6, 7, 0, 1, 5, 0, 5, 4, 1, 2, 6, 1, 6, 5, 2, 3, 7, 2, 7, 6, 3, 0, 4, 3, 4, 7,
        };
        var top = new Vec3(h, h, h);
        SampleRow[] samples =
        {
            new SampleRow { Component = 1, PositionM = top, DeflectionM = 0.005, Value = 1.0 },
            new SampleRow { Component = 1, PositionM = top, DeflectionM = 0.010, Value = 3.0 },
            new SampleRow { Component = 2, PositionM = top, DeflectionM = 0.005, Value = 1.5 },
        };
        using (var body = Body.FromArrays(positions, triangles, samples, friction: 0.3))
        using (var contact = new Contact(body))
        {
            Console.WriteLine(Library.Version);
            for (int k = 0; k <= 60; k++)
            {
                var output = contact.Step(new Vec3(0.01, 0.02, h + 1e-3 - 1e-4 * k), 1e-3);
                if (k % 20 == 0)
                    Console.WriteLine("{0:F1} mm deep: {1:F3} N, {2}", output.DeltaZM * 1e3, output.ForceN.Z, (StepFlags)output.Flags);
            }
        }
    }

    static void SamePath(string bodyFile, string pathFile)
    {
        byte[] bytes = File.ReadAllBytes(pathFile);
        int n = bytes.Length / (7 * sizeof(double));
        double[] times = new double[n], positions = new double[3 * n], orientations = new double[4 * n];
        for (int k = 0; k < n; k++)
        {
            times[k] = BitConverter.ToDouble(bytes, 56 * k);
            for (int i = 0; i < 3; i++) positions[3 * k + i] = BitConverter.ToDouble(bytes, 56 * k + 8 * (1 + i));
            orientations[4 * k] = 1.0;
        }
        var lines = new StringBuilder();
        using (var body = Body.Open(bodyFile))
        {
            using (var contact = new Contact(body))
            {
                for (int k = 0; k < n; k++)
                {
                    var at = new Vec3(positions[3 * k], positions[3 * k + 1], positions[3 * k + 2]);
                    var output = contact.Step(at, k == 0 ? 0.0 : times[k] - times[k - 1]);
                    Bits(lines, "step", output.ForceN, output.TorqueNm);
                }
            }
            double[] forces = new double[3 * n], torques = new double[3 * n];
            using (var contact = new Contact(body)) contact.Rollout(times, positions, forces, orientations, torques);
            for (int k = 0; k < n; k++) Bits(lines, "rollout", Of(forces, k), Of(torques, k));

            const int copies = 5;
            var contacts = new Contact[copies];
            double[][] allTimes = new double[copies][], allPositions = new double[copies][];
            double[][] allForces = new double[copies][], allTorques = new double[copies][];
            for (int c = 0; c < copies; c++)
            {
                contacts[c] = new Contact(body);
                allTimes[c] = times;
                allPositions[c] = positions;
                allForces[c] = new double[3 * n];
                allTorques[c] = new double[3 * n];
            }
            Contact.RolloutMany(contacts, allTimes, allPositions, allForces, allTorques);
            for (int k = 0; k < n; k++) Bits(lines, "many", Of(allForces[copies - 1], k), Of(allTorques[copies - 1], k));
            foreach (var contact in contacts) contact.Dispose();
        }
        Console.Out.Write(lines.ToString());
    }

    static Vec3 Of(double[] all, int k) { return new Vec3(all[3 * k], all[3 * k + 1], all[3 * k + 2]); }

    static void Bits(StringBuilder lines, string way, Vec3 force, Vec3 torque)
    {
        lines.Append(way);
        foreach (double x in new[] { force.X, force.Y, force.Z, torque.X, torque.Y, torque.Z })
            lines.Append(' ').Append(BitConverter.DoubleToInt64Bits(x).ToString("x16"));
        lines.Append('\n');
    }
}
