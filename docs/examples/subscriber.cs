// Prints where the tip is, and tells when points were lost. Reads recorded points:
//
//   dotnet run < points.bin        (in a folder made by `dotnet new console`, this file as Program.cs)
//   mcs subscriber.cs && mono subscriber.exe < points.bin
//
// Live: give each payload of the key armd/SERIAL/point to `Subscriber.Take`, from whatever binding of
// Zenoh 1.x you use, in mode "client" with the daemon's endpoint (zenoh-csharp is the project's own).
using System;
using System.Globalization;
using System.IO;

/// <summary>armd.point.v1: 136 bytes, little-endian, as BinaryReader reads (docs/reference/subscriber.md).</summary>
public sealed class ArmdPoint
{
    public const int Size = 136;
    public const uint Invalid = 1u << 0;
    public const uint SamplesLost = 1u << 6;

    public ulong Seq;
    public long StampNs, MonotonicNs;
    public double[] PositionMm = new double[3];   // base frame
    public double[] Orientation = new double[4];  // x y z w: turns the last frame into the base frame
    public float[] CovarianceMm2 = new float[6];  // xx xy xz yy yz zz
    public float[] CorrectionMm = new float[3];
    public uint Flags, Buttons;
    public string Calibration = "-";              // as JSON writes it; "-": none

    public static ArmdPoint From(byte[] payload)
    {
        if (payload.Length != Size) throw new InvalidDataException(payload.Length + " bytes, not " + Size);
        var p = new ArmdPoint();
        using (var from = new BinaryReader(new MemoryStream(payload)))
        {
            p.Seq = from.ReadUInt64();
            p.StampNs = from.ReadInt64();
            p.MonotonicNs = from.ReadInt64();
            for (int i = 0; i < 3; i++) p.PositionMm[i] = from.ReadDouble();
            for (int i = 0; i < 4; i++) p.Orientation[i] = from.ReadDouble();
            for (int i = 0; i < 6; i++) p.CovarianceMm2[i] = from.ReadSingle();
            for (int i = 0; i < 3; i++) p.CorrectionMm[i] = from.ReadSingle();
            p.Flags = from.ReadUInt32();
            byte[] calibration = from.ReadBytes(8);
            if (BitConverter.ToUInt64(calibration, 0) != 0)
                p.Calibration = BitConverter.ToString(calibration).Replace("-", "").ToLowerInvariant();
            p.Buttons = from.ReadUInt32();
        }
        return p;
    }
}

public sealed class Subscriber
{
    public ulong Upstream, Here, Restarts;
    private ulong? _last;

    public void Take(byte[] payload)
    {
        var p = ArmdPoint.From(payload);
        if (_last.HasValue)
        {
            ulong last = _last.Value;
            if (p.Seq >> 32 != last >> 32 || p.Seq <= last) Restarts++;
            else if ((p.Flags & ArmdPoint.SamplesLost) != 0) Upstream += p.Seq - last - 1;
            else Here += p.Seq - last - 1;
        }
        _last = p.Seq;
        if ((p.Flags & ArmdPoint.Invalid) != 0) Console.WriteLine(p.Seq + " invalid");
        else
            Console.WriteLine(string.Format(
                CultureInfo.InvariantCulture, "{0} {1:F6} {2:F6} {3:F6} mm flags {4} calibration {5}",
                p.Seq, p.PositionMm[0], p.PositionMm[1], p.PositionMm[2], p.Flags, p.Calibration));
    }

    public static void Main()
    {
        var subscriber = new Subscriber();
        using (var input = new BinaryReader(Console.OpenStandardInput()))
        {
            byte[] payload;
            while ((payload = input.ReadBytes(ArmdPoint.Size)).Length == ArmdPoint.Size)
                subscriber.Take(payload);
        }
        Console.WriteLine(
            "lost: " + subscriber.Upstream + " upstream, " + subscriber.Here + " here, "
            + subscriber.Restarts + " restarts");
    }
}
