using UnityEngine;

namespace Palpate.Unity
{
    /// <summary>The sample: leads a PalpateTool down into the body and round, draws the force as a ray, and says when contact begins and
    /// ends. Put it beside a PalpateTool whose object is a little above the body.</summary>
    [RequireComponent(typeof(PalpateTool))]
    public class PalpateSample : MonoBehaviour
    {
        [Tooltip("How deep the tool goes below where it begins, m")]
        public float depth = 0.006f;
        [Tooltip("Radius of the circle that it is led in, m")]
        public float radius = 0.005f;

        PalpateTool tool;
        Vector3 start;
        float time;
        bool wasTouching;

        void Start()
        {
            tool = GetComponent<PalpateTool>();
            start = transform.position;
        }

        void FixedUpdate()
        {
            time += Time.fixedDeltaTime;
            float down = depth * Mathf.Min(time, 1f), turn = Mathf.Max(0f, time - 1f);
            transform.position = start + new Vector3(radius * Mathf.Sin(turn), -down, radius * (1f - Mathf.Cos(turn)));
            Debug.DrawRay(transform.position, tool.Force * 0.01f);
            if (tool.IsTouching != wasTouching) Debug.Log(tool.IsTouching ? "touched" : "let go");
            wasTouching = tool.IsTouching;
        }
    }
}
