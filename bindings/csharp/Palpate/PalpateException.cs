using System;

namespace Palpate
{
    /// <summary>What a call of the library returned; as PALPATE_STATUS_... in palpate.h.</summary>
    public enum Status
    {
        Ok = 0, Null = 1, WrongSize = 2, WrongVersion = 3, Closed = 4, Busy = 5, OtherBody = 6, Invalid = 7, Body = 8,
        Session = 9, TooSmall = 10, Cancelled = 11, Unsupported = 12, Nothing = 13, Panic = 14,
    }

    /// <summary>Why a call failed, where, and how to mend it.</summary>
    public sealed class PalpateException : Exception
    {
        internal PalpateException(Status status, string message) : base(message) { Status = status; }
        public Status Status { get; private set; }
    }

    /// <summary>What happened in a step; as PALPATE_FLAG_... in palpate.h.</summary>
    [Flags]
    public enum StepFlags : uint
    {
        None = 0, InContact = 1, Slipping = 2, Onset = 4, Released = 8, Reanchored = 16, Border = 32, Blocked = 64, Capped = 128,
        InvalidPose = 256, Contained = 512, StartedInside = 1024, PatchBoundary = 2048, InvalidTime = 4096, OtherBody = 8192,
        HeldBack = 16384, Pulling = 32768,
    }

    /// <summary>A slip rule; as PALPATE_SLIP_... in palpate.h.</summary>
    public enum SlipRule : uint
    {
        /// <summary>What the body asks for.</summary>
        OfTheBody = 0,
        Paper = 1, Consistent = 2, Exact = 3,
    }

    /// <summary>The library.</summary>
    public static class Library
    {
        /// <summary>Version, commit and features.</summary>
        public static string Version { get { return Native.Text(Native.palpate_version()); } }
        /// <summary>Whether bodies are made from specs.</summary>
        public static bool CanBuild { get { return (Native.palpate_features() & 2) != 0; } }
        /// <summary>Whether the drivers of vendors' devices are built in.</summary>
        public static bool HasDevices { get { return (Native.palpate_features() & 1) != 0; } }
    }
}
