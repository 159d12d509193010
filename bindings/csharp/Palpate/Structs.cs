// The structs of palpate.h, member by member; what each is, with units and frames, is said there and in docs/c-reference.md. A test
// compares sizes and places with the C library's.

using System;
using System.Runtime.InteropServices;

namespace Palpate
{
    /// <summary>A vector x y z.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Vec3
    {
        public double X, Y, Z;
        public Vec3(double x, double y, double z) { X = x; Y = y; Z = z; }
        public double Length { get { return Math.Sqrt(X * X + Y * Y + Z * Z); } }
        public override string ToString() { return "(" + X + ", " + Y + ", " + Z + ")"; }
    }

    /// <summary>A quaternion w x y z.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Quat
    {
        public double W, X, Y, Z;
        public Quat(double w, double x, double y, double z) { W = w; X = x; Y = y; Z = z; }
        public static readonly Quat Identity = new Quat(1, 0, 0, 0);
    }

    /// <summary>Spare words of a record.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Words2
    {
        public ulong A, B;
    }

    /// <summary>Energies of a contact, J.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Ledger
    {
        internal uint StructSize;
        internal uint Reserved;
        public double WorkJ;
        public double StoredJ;
        public double DissipatedJ;
        public double GeneratedJ;
        public double TankJ;
        public double RelaxedJ;
    }

    /// <summary>Where the tool is, in the body's frame.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct ToolState
    {
        internal uint StructSize;
        internal uint Reserved;
        public Vec3 PositionM;
        public Quat Orientation;
    }

    /// <summary>What a step answers.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Output
    {
        internal uint StructSize;
        public uint Flags;
        public Vec3 ForceN;
        public Vec3 TorqueNm;
        public uint Element;
        internal uint Reserved;
        public Vec3 AreaCoordinates;
        public Vec3 ContactPositionM;
        public double DeltaZM;
        public double DeltaRM;
        public Ledger Energy;
    }

    /// <summary>How often things happened.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Counters
    {
        internal uint StructSize;
        internal uint Reserved;
        public ulong Steps;
        public ulong Onsets;
        public ulong Slips;
        public ulong Evaluations;
        public ulong Crossings;
        public ulong Queries;
        public ulong Blocked;
        public ulong Fenced;
        public ulong Capped;
        public ulong HeldBack;
        public ulong InvalidPoses;
        public ulong InvalidTimes;
        public ulong Contained;
    }

    /// <summary>What a body is.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct BodyInfo
    {
        internal uint StructSize;
        public uint SlipRule;
        public uint HasTank;
        public uint IsCoupled;
        public uint IsIsotropic;
        public uint Tool;
        public double ToolRadiusM;
        public ulong Nodes;
        public ulong Vertices;
        public ulong Elements;
        public ulong TestPoints;
        public ulong Identity;
        public Vec3 LowM;
        public Vec3 HighM;
        public double DepthMaxM;
        public double StiffnessMaxNPerM;
        public double StiffnessAsideNPerM;
    }

    /// <summary>One measured value.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct SampleRow
    {
        public uint Point;
        public uint Component;
        public Vec3 PositionM;
        public double DeflectionM;
        public double Value;
    }

    /// <summary>A device in a sampled loop, as certificates ask for it.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct LoopDevice
    {
        internal uint StructSize;
        internal uint Reserved;
        public double DampingNSPerM;
        public double RateHz;
        public double PositionErrorM;
        public double CoulombN;
        public double DelaySamples;
    }

    /// <summary>What is proved of a body; NaN stands for what is not known.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Certificate
    {
        internal uint StructSize;
        public uint SlipRule;
        public uint PassiveHolds;
        public uint SnapFreeHolds;
        public double PassiveMargin;
        public double PassiveFound;
        public ulong PassiveProvedElements;
        public ulong PassiveFailingElements;
        public ulong PassiveUndecidedElements;
        public uint PassiveWorstElement;
        public uint SnapFreeWorstElement;
        public Vec3 PassiveWorstM;
        public double SnapFreeMarginNPerM;
        public double SnapFreeFoundNPerM;
        public ulong SnapFreeProvedElements;
        public ulong SnapFreeFailingElements;
        public ulong SnapFreeUndecidedElements;
        public Vec3 SnapFreeWorstM;
        public double LipschitzNPerM;
        public double LipschitzFoundNPerM;
        public double StiffnessMaxNPerM;
        public double DepthM;
        public double StepM;
        public double LateralM;
        public double PassiveFromM;
        public ulong Elements;
        public ulong BorderEdges;
        public ulong CreasedElements;
        public ulong TooFarElements;
        public double DeviceStiffnessLimitNPerM;
        public double DeviceDepthLimitM;
        public double DeviceForceLimitN;
        public double DeviceContactWayRatio;
        public uint DeviceWholeDepth;
        internal uint Reserved;
    }

    /// <summary>The latest period of a session.</summary>
    [StructLayout(LayoutKind.Sequential)]
    public struct Record
    {
        internal uint StructSize;
        internal uint Reserved;
        public uint Kind;
        public uint StageFlags;
        public ulong Number;
        public double TimeS;
        public ulong StartedNs;
        public long LatenessNs;
        public ulong PeriodNs;
        public uint StepNs;
        public uint ReadNs;
        public uint WriteNs;
        public uint Fault;
        public long FaultCode;
        public ulong DeviceSequence;
        public Vec3 DevicePositionM;
        public Quat DeviceOrientation;
        public Vec3 DeviceVelocityMPerS;
        public uint DeviceButtons;
        public uint DeviceStatus;
        public Vec3 ToolPositionM;
        public Quat ToolOrientation;
        public Vec3 ForceN;
        public Vec3 TorqueNm;
        public Vec3 AreaCoordinates;
        public Vec3 ContactPositionM;
        public double DeltaZM;
        public double DeltaRM;
        public uint Element;
        public uint EngineFlags;
        public double WorkJ;
        public double StoredJ;
        public double DissipatedJ;
        public double GeneratedJ;
        public double OutJ;
        public double SquaresM2;
        public double ObservedJ;
        public Vec3 CommandForceN;
        public Vec3 CommandTorqueNm;
        public Vec3 PatchCentreM;
        public ulong PatchSerial;
        public uint PatchCount;
        internal uint SpareHalf;
        public ulong PatchWaits;
        public uint MinorFaults;
        public uint MajorFaults;
        public Vec3 DeviceAngularVelocityRadPerS;
        public double SquaresRad2;
        public double FrictionScale;
        public double TankJ;
        internal Words2 Spare;
        public uint SlipRuleCode;
        internal uint Crc;
    }

    /// <summary>What became of a session.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeOutcome
    {
        public uint StructSize;
        public uint End;
        public uint IsWell;
        public uint IsRecordingCut;
        public ulong Periods;
        public ulong PeriodsInContact;
        public ulong Overruns;
        public ulong Recorded;
        public double ForceMaxN;
        public double TorqueMaxNm;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 512)]
        public byte[] Message;
    }

    /// <summary>How a contact is to be.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeContactOptions
    {
        public uint StructSize;
        public uint AbiVersion;
        public uint SlipRule;
        public uint Tank;
        public uint Ablation;
        public uint Reserved;
        public double FrictionScale;
    }

    /// <summary>For which motions a body is certified.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeCertifyOptions
    {
        public uint StructSize;
        public uint SlipRule;
        public uint Evaluations;
        public uint Threads;
        public double StepM;
        public double DepthM;
        public IntPtr Device;
    }

    /// <summary>Arrays of a path, pinned.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativePath
    {
        public uint StructSize;
        public uint Reserved;
        public UIntPtr Count;
        public IntPtr TimesS;
        public IntPtr PositionsM;
        public IntPtr Orientations;
    }

    /// <summary>Arrays that a rollout writes to, pinned.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeTrace
    {
        public uint StructSize;
        public uint Reserved;
        public IntPtr ForcesN;
        public IntPtr TorquesNm;
        public IntPtr Flags;
        public IntPtr Energies;
        public IntPtr Outputs;
    }

    /// <summary>What a body is made of, pinned.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeBodyArrays
    {
        public uint StructSize;
        public uint AbiVersion;
        public IntPtr PositionsM;
        public UIntPtr VertexCount;
        public IntPtr Triangles;
        public UIntPtr TriangleCount;
        public IntPtr Samples;
        public UIntPtr SampleCount;
        public uint SampleSize;
        public uint IsOpen;
        public double CreaseAngleRad;
        public double DefaultFriction;
        public double ToolRadiusM;
        public uint SlipRule;
        public uint WithoutTank;
        public uint Between;
        public uint Reserved;
    }

    /// <summary>How far long work is.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeProgress
    {
        public uint StructSize;
        public uint Reserved;
        public ulong PointsDone;
        public ulong Points;
        public IntPtr Message;
    }

    /// <summary>Status and message of a call.</summary>
    [StructLayout(LayoutKind.Sequential)]
    internal struct NativeError
    {
        public uint StructSize;
        public int Status;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 1016)]
        public byte[] Message;
    }
}
