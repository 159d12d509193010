using UnityEngine;

namespace Palpate.Unity
{
    /// <summary>A soft body as a component: its file (a .body renamed to .bytes, as a text asset, or a path), and its surface as a mesh
    /// if there is a mesh filter beside it. One unit of the scene is a metre; scale the object to see it larger.</summary>
    public class PalpateBody : MonoBehaviour
    {
        [Tooltip("The body file as an asset, with the ending .bytes")]
        public TextAsset asset;
        [Tooltip("Without an asset: the body file's path")]
        public string file;

        /// <summary>What is touched; null before the component wakes, and after it is destroyed.</summary>
        public Body Body { get; private set; }

        void Awake()
        {
            Body = asset != null ? Body.FromMemory(asset.bytes) : Body.Open(file);
            var filter = GetComponent<MeshFilter>();
            if (filter != null) filter.mesh = SurfaceMesh();
        }

        void OnDestroy()
        {
            if (Body != null) Body.Dispose();
            Body = null;
        }

        Mesh SurfaceMesh()
        {
            double[] positions;
            uint[] triangles;
            Body.Surface(out positions, out triangles);
            var vertices = new Vector3[positions.Length / 3];
            for (int k = 0; k < vertices.Length; k++)
                vertices[k] = UnityFrame.ToUnity(new Vec3(positions[3 * k], positions[3 * k + 1], positions[3 * k + 2]));
            var mesh = new Mesh { indexFormat = UnityEngine.Rendering.IndexFormat.UInt32 };
            mesh.vertices = vertices;
            // Counter-clockwise from outside there, clockwise here.
            var corners = new int[triangles.Length];
            for (int k = 0; k < corners.Length; k += 3)
            {
                corners[k] = (int)triangles[k];
                corners[k + 1] = (int)triangles[k + 2];
                corners[k + 2] = (int)triangles[k + 1];
            }
            mesh.triangles = corners;
            mesh.RecalculateNormals();
            return mesh;
        }
    }
}
