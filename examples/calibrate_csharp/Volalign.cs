// volalign for C#, as Unity and other .NET programs call it: the functions of volalign.h that a calibration needs.
// Put libvolalign_c.so.0 where the system's loader finds it (LD_LIBRARY_PATH, or beside the program).
using System;
using System.Collections.Generic;
using System.Runtime.InteropServices;
using System.Text;

public class VolalignException : Exception
{
    public readonly int Code;  // volalign_code of volalign.h
    public VolalignException(int code, string message) : base(message) { Code = code; }
}

/// <summary>A sensor's outcome. Lengths in metres, matrices row by row.</summary>
public class SensorPose
{
    public string Name, Code, Reason, Hint;
    public int Status;  // 0 ok, 1 weak, 2 failed
    public double[] StructureFromSensor;  // 4 x 4, null where the sensor is failed
    public double[] Covariance;           // 6 x 6
}

/// <summary>One still frame of each sensor, and where they stand.</summary>
public sealed class Calibration : IDisposable
{
    private const string Library = "libvolalign_c.so.0";

    [StructLayout(LayoutKind.Sequential)]
    private struct Frame
    {
        public UIntPtr StructSize;
        public IntPtr Name, Sensor;
        public int Width, Height;
        public double Fx, Fy, Cx, Cy;
        public int DistortionCount;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 8)] public double[] Distortion;
        public IntPtr Depth, Raw;
        public double RawScale;
        public int OrientationKnown, QuarterTurns;
    }

    [StructLayout(LayoutKind.Sequential)]
    private struct Sensor
    {
        public UIntPtr StructSize;
        public IntPtr Name;
        public int Status;
        public IntPtr Code, Reason, Hint;
        public int HasPose;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 16)] public double[] StructureFromSensor;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 36)] public double[] Covariance;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 3)] public double[] SigmaPosition;
        public double RmsToStructure, Fx, Fy, Cx, Cy;
        public int DistortionCount;
        [MarshalAs(UnmanagedType.ByValArray, SizeConst = 8)] public double[] Distortion;
    }

    [UnmanagedFunctionPointer(CallingConvention.Cdecl)]
    private delegate int Progress(IntPtr stage, IntPtr user);

    [DllImport(Library)] private static extern IntPtr volalign_last_error();
    [DllImport(Library)] private static extern IntPtr volalign_tool();
    [DllImport(Library)] private static extern int volalign_capture_create(byte[] structure, out IntPtr capture);
    [DllImport(Library)] private static extern int volalign_capture_add(IntPtr capture, ref Frame frame);
    [DllImport(Library)] private static extern void volalign_capture_free(IntPtr capture);
    [DllImport(Library)] private static extern int volalign_model_load(byte[] onnx, out IntPtr model);
    [DllImport(Library)] private static extern void volalign_model_free(IntPtr model);
    [DllImport(Library)] private static extern int volalign_calibrate(IntPtr capture, IntPtr model, IntPtr options, Progress progress, IntPtr user, out IntPtr result);
    [DllImport(Library)] private static extern int volalign_result_count(IntPtr result);
    [DllImport(Library)] private static extern int volalign_result_sensor(IntPtr result, int index, ref Sensor sensor);
    [DllImport(Library)] private static extern int volalign_result_save(IntPtr result, byte[] folder, int withReport);
    [DllImport(Library)] private static extern void volalign_result_free(IntPtr result);

    private IntPtr capture, model, result;

    /// <param name="structure">the stack's file, .yaml</param>
    /// <param name="onnx">a network, or null: poses from the shape of the stack alone</param>
    public Calibration(string structure, string onnx)
    {
        Require(volalign_capture_create(Utf8(structure), out capture));
        if (onnx != null) Require(volalign_model_load(Utf8(onnx), out model));
    }

    public static string Tool { get { return Text(volalign_tool()); } }

    /// <param name="millimetres">row by row, 0 where nothing was measured</param>
    public void Add(string name, string kind, int width, int height, double fx, double fy, double cx, double cy, double[] distortion, ushort[] millimetres)
    {
        if (millimetres.Length != width * height) throw new ArgumentException("depth has not width * height values");
        var frame = new Frame { StructSize = (UIntPtr)Marshal.SizeOf(typeof(Frame)), Width = width, Height = height, Fx = fx, Fy = fy, Cx = cx, Cy = cy,
                                DistortionCount = distortion.Length, Distortion = new double[8], RawScale = 0.001 };
        distortion.CopyTo(frame.Distortion, 0);
        GCHandle pixels = GCHandle.Alloc(millimetres, GCHandleType.Pinned);
        GCHandle nameBytes = GCHandle.Alloc(Utf8(name), GCHandleType.Pinned);
        GCHandle kindBytes = GCHandle.Alloc(Utf8(kind ?? ""), GCHandleType.Pinned);
        try
        {
            frame.Raw = pixels.AddrOfPinnedObject();
            frame.Name = nameBytes.AddrOfPinnedObject();
            frame.Sensor = kindBytes.AddrOfPinnedObject();
            Require(volalign_capture_add(capture, ref frame));
        }
        finally
        {
            pixels.Free();
            nameBytes.Free();
            kindBytes.Free();
        }
    }

    /// <param name="progress">told what begins; returns false to stop. May be null.</param>
    public List<SensorPose> Run(Func<string, bool> progress)
    {
        Progress callback = null;
        if (progress != null) callback = (stage, user) => progress(Text(stage)) ? 0 : 1;
        volalign_result_free(result);
        Require(volalign_calibrate(capture, model, IntPtr.Zero, callback, IntPtr.Zero, out result));
        GC.KeepAlive(callback);
        var sensors = new List<SensorPose>();
        for (int i = 0; i < volalign_result_count(result); ++i)
        {
            var sensor = new Sensor { StructSize = (UIntPtr)Marshal.SizeOf(typeof(Sensor)) };
            Require(volalign_result_sensor(result, i, ref sensor));
            sensors.Add(new SensorPose { Name = Text(sensor.Name), Status = sensor.Status, Code = Text(sensor.Code), Reason = Text(sensor.Reason),
                                         Hint = Text(sensor.Hint), StructureFromSensor = sensor.HasPose != 0 ? sensor.StructureFromSensor : null,
                                         Covariance = sensor.Covariance });
        }
        return sensors;
    }

    /// <summary>Writes the folder that `volalign calibrate -o` writes, with its report.</summary>
    public void Save(string folder) { Require(volalign_result_save(result, Utf8(folder), 1)); }

    public void Dispose()
    {
        volalign_result_free(result);
        volalign_model_free(model);
        volalign_capture_free(capture);
        result = model = capture = IntPtr.Zero;
    }

    private static byte[] Utf8(string text) { return Encoding.UTF8.GetBytes(text + "\0"); }

    private static string Text(IntPtr utf8)
    {
        int length = 0;
        while (Marshal.ReadByte(utf8, length) != 0) ++length;
        var bytes = new byte[length];
        Marshal.Copy(utf8, bytes, 0, length);
        return Encoding.UTF8.GetString(bytes);
    }

    private static void Require(int code)
    {
        if (code != 0) throw new VolalignException(code, Text(volalign_last_error()));
    }
}
