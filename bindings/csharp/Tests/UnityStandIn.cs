// As much of Unity's scripting interface as the components in ../Unity use, to compile and run them without it. Transforms have place and
// a turn about the vertical axis.

using System;
using System.Collections.Generic;
using System.Reflection;

namespace UnityEngine.Rendering
{
    public enum IndexFormat { UInt16, UInt32 }
}

namespace UnityEngine
{
    public struct Vector3
    {
        public float x, y, z;
        public Vector3(float x, float y, float z) { this.x = x; this.y = y; this.z = z; }
        public static Vector3 zero { get { return new Vector3(); } }
        public static Vector3 operator +(Vector3 a, Vector3 b) { return new Vector3(a.x + b.x, a.y + b.y, a.z + b.z); }
        public static Vector3 operator -(Vector3 a, Vector3 b) { return new Vector3(a.x - b.x, a.y - b.y, a.z - b.z); }
        public static Vector3 operator *(Vector3 a, float s) { return new Vector3(a.x * s, a.y * s, a.z * s); }
        public static Vector3 Cross(Vector3 a, Vector3 b)
        {
            return new Vector3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
        }
        public static float Dot(Vector3 a, Vector3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
    }

    public struct Quaternion
    {
        public float x, y, z, w;
        public Quaternion(float x, float y, float z, float w) { this.x = x; this.y = y; this.z = z; this.w = w; }
        public static Quaternion identity { get { return new Quaternion(0, 0, 0, 1); } }
        public static Quaternion Inverse(Quaternion q) { return new Quaternion(-q.x, -q.y, -q.z, q.w); }
        public static Quaternion operator *(Quaternion a, Quaternion b)
        {
            return new Quaternion(a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y, a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x,
                                  a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w, a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z);
        }
        public static Vector3 operator *(Quaternion q, Vector3 v)
        {
            var u = new Vector3(q.x, q.y, q.z);
            return v + Vector3.Cross(u, Vector3.Cross(u, v) + v * q.w) * 2;
        }
    }

    public static class Mathf
    {
        public static int Max(int a, int b) { return Math.Max(a, b); }
        public static float Max(float a, float b) { return Math.Max(a, b); }
        public static float Min(float a, float b) { return Math.Min(a, b); }
        public static int RoundToInt(float a) { return (int)Math.Round(a); }
        public static float Sin(float a) { return (float)Math.Sin(a); }
        public static float Cos(float a) { return (float)Math.Cos(a); }
    }

    public static class Time
    {
        public static float fixedDeltaTime = 0.02f;
    }

    public static class Debug
    {
        public static readonly List<string> said = new List<string>();
        public static void Log(object message) { said.Add(message.ToString()); }
        public static void LogWarning(object message) { said.Add("warning: " + message); }
        public static void LogError(object message) { said.Add("error: " + message); }
        public static void DrawRay(Vector3 start, Vector3 direction) { }
    }

    public class TextAsset { public byte[] bytes; }

    public class Mesh
    {
        public Rendering.IndexFormat indexFormat;
        public Vector3[] vertices;
        public int[] triangles;
        public void RecalculateNormals() { }
    }

    public sealed class TooltipAttribute : Attribute { public TooltipAttribute(string words) { } }
    public sealed class TextAreaAttribute : Attribute { }
    public sealed class RequireComponent : Attribute { public RequireComponent(Type type) { } }

    public class Component
    {
        public GameObject gameObject;
        public Transform transform { get { return gameObject.transform; } }
        public T GetComponent<T>() where T : Component { return gameObject.GetComponent<T>(); }
    }

    public class MeshFilter : Component { public Mesh mesh; }
    public class MonoBehaviour : Component { }

    public class Transform
    {
        public Vector3 position;
        public Quaternion rotation = Quaternion.identity;
        public Vector3 TransformPoint(Vector3 v) { return position + rotation * v; }
        public Vector3 InverseTransformPoint(Vector3 v) { return Quaternion.Inverse(rotation) * (v - position); }
        public Vector3 TransformDirection(Vector3 v) { return rotation * v; }
    }

    public class GameObject
    {
        public readonly Transform transform = new Transform();
        readonly List<Component> components = new List<Component>();
        public T AddComponent<T>() where T : Component, new()
        {
            var component = new T { gameObject = this };
            components.Add(component);
            return component;
        }
        public T GetComponent<T>() where T : Component
        {
            return (T)components.Find(c => c is T);
        }
        /// <summary>Calls a message of Unity's on all components that have it.</summary>
        public void Send(string message)
        {
            foreach (var component in components)
            {
                var method = component.GetType().GetMethod(message, BindingFlags.Instance | BindingFlags.NonPublic | BindingFlags.Public);
                if (method != null) method.Invoke(component, null);
            }
        }
    }
}
