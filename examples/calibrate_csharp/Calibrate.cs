// Calibrates sensors whose depth frames a .NET program has in memory: see examples/calibrate_c/main.c, whose arguments and output it has.
//
//     mcs -out:calibrate.exe Calibrate.cs Volalign.cs && mono calibrate.exe structure.yaml model.onnx sensors.txt [folder]
using System;
using System.Globalization;
using System.IO;
using System.Linq;
using System.Text;

public static class Program
{
    private static ushort[] ReadPgm(string path, out int width, out int height)
    {
        byte[] bytes = File.ReadAllBytes(path);
        var header = new StringBuilder();
        int at = 0, words = 0;
        while (words < 4)  // P5 WIDTH HEIGHT 65535, each followed by one blank
        {
            char next = (char)bytes[at++];
            header.Append(next);
            if (char.IsWhiteSpace(next)) ++words;
        }
        string[] parts = header.ToString().Split(new[] { ' ', '\n' }, StringSplitOptions.RemoveEmptyEntries);
        width = int.Parse(parts[1]);
        height = int.Parse(parts[2]);
        var depth = new ushort[width * height];
        for (int i = 0; i < depth.Length; ++i) depth[i] = (ushort)(bytes[at + 2 * i] << 8 | bytes[at + 2 * i + 1]);
        return depth;
    }

    public static int Main(string[] args)
    {
        if (args.Length < 3)
        {
            Console.Error.WriteLine("usage: calibrate.exe structure.yaml model.onnx|- sensors.txt [folder]");
            return 2;
        }
        CultureInfo plain = CultureInfo.InvariantCulture;
        try
        {
            using (var calibration = new Calibration(args[0], args[1] == "-" ? null : args[1]))
            {
                foreach (string line in File.ReadAllLines(args[2]))
                {
                    string[] words = line.Split(new[] { ' ' }, StringSplitOptions.RemoveEmptyEntries);
                    if (words.Length < 7) continue;
                    Func<string, double> number = text => double.Parse(text, plain);
                    int width, height;
                    ushort[] depth = ReadPgm(words[6], out width, out height);
                    calibration.Add(words[0], words[1] == "-" ? null : words[1], width, height, number(words[2]), number(words[3]), number(words[4]),
                                    number(words[5]), words.Skip(7).Select(number).ToArray(), depth);
                }
                bool failed = false;
                foreach (SensorPose sensor in calibration.Run(stage => { Console.Error.WriteLine(stage); return true; }))
                {
                    failed |= sensor.Status == 2;
                    string pose = sensor.StructureFromSensor == null ? "" : " " + string.Join(" ", sensor.StructureFromSensor.Select(x => x.ToString("R", plain)));
                    Console.WriteLine(sensor.Name + " " + sensor.Status + pose + (sensor.Reason == "" ? "" : " # " + sensor.Reason));
                }
                if (args.Length > 3) calibration.Save(args[3]);
                return failed ? 3 : 0;
            }
        }
        catch (VolalignException error)
        {
            Console.Error.WriteLine("error " + error.Code + ": " + error.Message);
            return 1;
        }
    }
}
