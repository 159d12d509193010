using UnityEngine;

namespace Palpate.Unity
{
    /// <summary>A body's frame is right-handed, with double precision; Unity's is left-handed, with y upwards. y and z change places, so
    /// that a body's z is up. A triangle that is counter-clockwise from outside there is clockwise here, as Unity wants it.</summary>
    public static class UnityFrame
    {
        public static Vector3 ToUnity(Vec3 v) { return new Vector3((float)v.X, (float)v.Z, (float)v.Y); }
        public static Vec3 ToBody(Vector3 v) { return new Vec3(v.x, v.z, v.y); }

        /// <summary>The axis changes places as a vector does, and the sense turns with the frame's handedness.</summary>
        public static Quat ToBody(Quaternion q) { return new Quat(q.w, -q.x, -q.z, -q.y); }
    }
}
