using UnityEngine;

namespace Palpate.Unity
{
    /// <summary>A body's frame is right-handed, with double precision; Unity's is left-handed, with y upwards. y and z change places, so
    /// that what is up in a body (z) is up in the scene, and nothing is mirrored.</summary>
    public static class UnityFrame
    {
        public static Vector3 ToUnity(Vec3 v) { return new Vector3((float)v.X, (float)v.Z, (float)v.Y); }
        public static Vec3 ToBody(Vector3 v) { return new Vec3(v.x, v.z, v.y); }

        /// <summary>The same turn: its axis changes places as a vector does, and left-handed frames count angles the other way.</summary>
        public static Quat ToBody(Quaternion q) { return new Quat(q.w, -q.x, -q.z, -q.y); }
    }
}
