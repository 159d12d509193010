using UnityEngine;

namespace Palpate.Unity
{
    /// <summary>A haptic device on a body, as a component: the session runs on the library's own threads, and this object goes where
    /// the tool is. Read docs/safety.md before the first touch of a real device.</summary>
    public class PalpateHaptics : MonoBehaviour
    {
        public PalpateBody touched;
        [Tooltip("Settings of docs/session.md as JSON")]
        [TextArea]
        public string settings = "{\"device\": \"simulated:touch\", \"safety\": {\"force_max_n\": 1}}";

        /// <summary>The session; null while the component is disabled.</summary>
        public Session Session { get; private set; }
        /// <summary>The latest period, in the body's and the device's frame; see Record.</summary>
        public Record Latest { get; private set; }
        /// <summary>The force on the tool before the output stages, in the scene's frame, N.</summary>
        public Vector3 Force { get; private set; }
        /// <summary>What became of the last session; null before its end.</summary>
        public Outcome Outcome { get; private set; }

        bool started;

        // Enabled before it starts, when the body's component may not have its body yet; and again after it was disabled.
        void Start()
        {
            started = true;
            Begin();
        }

        void OnEnable()
        {
            if (started) Begin();
        }

        void Begin()
        {
            if (Session != null) return;
            Outcome = null;
            Session = new Session(touched.Body, settings);
            if (Session.Notes.Length > 0) Debug.LogWarning(Session.Notes);
            Session.Start();
        }

        void Update()
        {
            Record record;
            if (Session == null || !Session.TryLatest(out record)) return;
            Latest = record;
            Transform frame = touched.transform;
            transform.position = frame.TransformPoint(UnityFrame.ToUnity(record.ToolPositionM));
            Force = frame.TransformDirection(UnityFrame.ToUnity(record.ForceN));
            if (Session.Wait(0)) End();
        }

        void OnDisable() { End(); }

        void End()
        {
            if (Session == null) return;
            Outcome = Session.Close();
            Session = null;
            Force = Vector3.zero;
            if (!Outcome.IsWell) Debug.LogError(Outcome.Words);
        }
    }
}
