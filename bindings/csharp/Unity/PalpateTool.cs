using UnityEngine;

namespace Palpate.Unity
{
    /// <summary>A tool without a device: wherever this object is moved to, it feels the body. Between two of Unity's fixed updates
    /// the way is divided into steps of a millisecond, as a haptic loop has them.</summary>
    public class PalpateTool : MonoBehaviour
    {
        public PalpateBody touched;
        [Tooltip("Steps a second")]
        public float rateHz = 1000;

        /// <summary>Force on the tool, in the scene's frame, N.</summary>
        public Vector3 Force { get; private set; }
        /// <summary>The contact point on the surface at rest, in the scene's frame.</summary>
        public Vector3 ContactPoint { get; private set; }
        public bool IsTouching { get; private set; }
        /// <summary>The last step's whole answer, in the body's frame.</summary>
        public Output Output { get; private set; }

        Contact contact;
        Vec3 last;
        bool hasLast;

        void OnDisable()
        {
            if (contact != null) contact.Dispose();
            contact = null;
            hasLast = false;
            IsTouching = false;
            Force = Vector3.zero;
        }

        void FixedUpdate()
        {
            if (touched == null || touched.Body == null) return;
            if (contact == null) contact = new Contact(touched.Body);
            Transform frame = touched.transform;
            Vec3 now = UnityFrame.ToBody(frame.InverseTransformPoint(transform.position));
            Quat turned = UnityFrame.ToBody(Quaternion.Inverse(frame.rotation) * transform.rotation);
            if (!hasLast) last = now;
            hasLast = true;
            int steps = Mathf.Max(1, Mathf.RoundToInt(Time.fixedDeltaTime * rateHz));
            double dt = Time.fixedDeltaTime / steps;
            Output output = default(Output);
            for (int k = 1; k <= steps; k++)
            {
                double s = (double)k / steps;
                var at = new Vec3(last.X + s * (now.X - last.X), last.Y + s * (now.Y - last.Y), last.Z + s * (now.Z - last.Z));
                output = contact.Step(at, turned, dt);
            }
            last = now;
            Output = output;
            IsTouching = ((StepFlags)output.Flags & StepFlags.InContact) != 0;
            // A direction: a scaled object does not scale forces.
            Force = frame.TransformDirection(UnityFrame.ToUnity(output.ForceN));
            ContactPoint = IsTouching ? frame.TransformPoint(UnityFrame.ToUnity(output.ContactPositionM)) : transform.position;
        }
    }
}
