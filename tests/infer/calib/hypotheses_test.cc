// What people do wrong with a capture or with the description of their boxes, and what is said.

#include "infer/calib/hypotheses.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "core/base/random.h"
#include "infer/report/report.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/pixels.h"
#include "tests/core/geometry/within.h"
#include "tests/infer/calib/calibrate_rig.h"
#include "tests/infer/view/synthetic.h"

namespace volalign::hypotheses_test {
namespace {

using namespace testing_infer;

Structure Boxes() {
  return Structure::FromBoxes("own",
                              {Box::FromMinMax("low", {-0.3, 0, -0.2}, {0.3, 0.35, 0.2}),
                               Box::FromMinMax("middle", {-0.3, 0.35, -0.15}, {0.1, 0.65, 0.15}),
                               Box::FromMinMax("high", {-0.2, 0.65, -0.1}, {0.2, 0.9, 0.15})});
}

/// Four sensors whose intrinsics differ as those of one kind do.
const Rig& Four() {
  static const Rig rig = [] {
    Rig made{Boxes(), {}, {}};
    for (int i = 0; i < 4; ++i) {
      Intrinsics intrinsics = Kinect();
      intrinsics.cx += 6 * (i - 1);
      intrinsics.cy -= 5 * (i - 1);
      made.Add(RingPose(30.0 + 85 * i, 2.0, 1.1, 90, {0, 0.4, 0}), {true, 3.0}, intrinsics);
      AddNoise(&made.frames.back().depth, 0.003, static_cast<std::uint64_t>(i));
      made.frames.back().quarter_turns = kAutoTurns;
    }
    return made;
  }();
  return rig;
}

const RigFinding* Find(const CalibrationResult& result, RigCode code) {
  const auto found = std::find_if(result.findings.begin(), result.findings.end(),
                                  [&](const RigFinding& finding) { return finding.code == code; });
  return found == result.findings.end() ? nullptr : &*found;
}

std::vector<SensorFrame> Scaled(std::vector<SensorFrame> frames, float factor) {
  for (SensorFrame& frame : frames) {
    for (float& z : frame.depth) z *= factor;
  }
  return frames;
}

TEST(Hypotheses, NothingIsSaidOfARigThatIsAsDescribed) {
  const CalibrationResult result = CalibrateByShape(Four().frames, Four().structure);
  EXPECT_TRUE(result.findings.empty()) << FormatReport(result);
  EXPECT_EQ(result.verdict(), SensorStatus::kOk) << FormatReport(result);
  EXPECT_TRUE(Has(FormatReport(result), "  geometry  "));
  for (const FrameResult& sensor : result.sensors) {
    EXPECT_TRUE(Within(sensor.error.value(), 0.004, 0.2)) << sensor.name;
    EXPECT_EQ(sensor.initial_source, PoseSource::kGeometry);
  }
}

TEST(Hypotheses, AWrongDescriptionIsNamed) {
  std::vector<Box> boxes = Boxes().boxes();
  std::swap(boxes[1].size.x(), boxes[1].size.z());
  const CalibrationResult result =
      CalibrateByShape(Four().frames, Structure::FromBoxes("turned", boxes));
  ASSERT_TRUE(result.assembly.has_value());
  EXPECT_EQ(result.assembly->arrangement.sentence, "box middle is turned by 90 deg");
  for (const FrameResult& sensor : result.sensors)
    EXPECT_EQ(sensor.code, SensorCode::kAssemblyTurned) << sensor.reason;
}

TEST(Hypotheses, AMirroredFrameIsNamed) {
  Rig rig = ThreeSensors();  // of a stack that is unlike its mirror image
  FlipFrame(rig.structure, &rig.frames[1], &rig.labels[1]);
  const CalibrationResult result = CalibrateByShape(rig.frames, rig.structure);
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(result.sensors[i].code, i == 1 ? SensorCode::kFrameMirrored : SensorCode::kNone)
        << result.sensors[i].reason;
}

// Two percent of depth_scale make 40 mm of the sensors' positions.
TEST(Hypotheses, ASizeFarOffItsPriorMakesTheRigWeak) {
  const CalibrationResult result = CalibrateByShape(Scaled(Four().frames, 1.03f), Four().structure);
  const RigFinding* size = Find(result, RigCode::kSizeOff);
  ASSERT_NE(size, nullptr) << FormatReport(result);
  EXPECT_TRUE(Has(size->reason, "size of all boxes differs by +"));
  EXPECT_TRUE(Has(size->hint, "depth_scale"));
  EXPECT_EQ(result.verdict(), SensorStatus::kWeak);
  EXPECT_TRUE(Has(FormatReport(result), "the rig is in doubt (size_off)"));
}

TEST(Hypotheses, OneBoxOfAnotherHeightIsNamed) {
  std::vector<Box> boxes = Boxes().boxes();
  boxes[1].size.y() += 0.02;
  boxes[1].structure_from_box.translation().y() += 0.01;
  boxes[2].structure_from_box.translation().y() += 0.02;
  const CalibrationResult result =
      CalibrateByShape(Four().frames, Structure::FromBoxes("own", std::move(boxes)));
  const RigFinding* box = Find(result, RigCode::kBoxOff);
  ASSERT_NE(box, nullptr) << FormatReport(result);
  EXPECT_EQ(box->about, std::vector<std::string>{"middle"});
  EXPECT_TRUE(Has(box->reason, "the height of box middle is", "mm less than described"));
  EXPECT_EQ(Find(result, RigCode::kSizeOff), nullptr) << FormatReport(result);
}

// Neither 1.2 nor 5 is a power of ten.
TEST(Hypotheses, TheDepthScaleAtWhichTheStructureIsFound) {
  for (const float factor : {1.2f, 5.0f}) {
    std::vector<SensorFrame> frames = Scaled(Four().frames, factor);
    frames.resize(2);
    const CalibrationResult result = CalibrateByShape(frames, Four().structure);
    EXPECT_EQ(result.placed(), 0) << factor;
    const RigFinding* scale = Find(result, RigCode::kDepthScale);
    ASSERT_NE(scale, nullptr) << FormatReport(result);
    const std::string set = "set depth_scale to ";
    ASSERT_EQ(scale->hint.find(set), 0U) << scale->hint;
    const double advised = std::stod(scale->hint.substr(set.size()));
    EXPECT_NEAR(advised * static_cast<double>(factor), 0.001, 0.00002) << scale->hint;
    // The advice, once followed.
    EXPECT_EQ(
        CalibrateByShape(Scaled(frames, static_cast<float>(advised / 0.001)), Four().structure)
            .placed(),
        2);
  }
}

TEST(Hypotheses, ExchangedDepthFiles) {
  std::vector<SensorFrame> frames = Four().frames;
  std::swap(frames[0].depth, frames[3].depth);
  const CalibrationResult result = CalibrateByShape(frames, Four().structure);
  ASSERT_FALSE(result.findings.empty()) << FormatReport(result);
  EXPECT_EQ(result.findings.front().code, RigCode::kFilesExchanged) << FormatReport(result);
  EXPECT_EQ(result.findings.front().about, (std::vector<std::string>{"S0", "S3"}));
  EXPECT_EQ(result.verdict(), SensorStatus::kWeak);
}

// A pair that is apart for another reason, and a second calibration that comes out better by
// chance. It is of the first capture, in which a third sensor has no frame.
TEST(Hypotheses, FilesAreExchangedOnlyWhereIntrinsicsDiffer) {
  for (const auto& [px, several] :
       {std::pair(2.0, false), std::pair(6.0, false), std::pair(6.0, true)}) {
    std::vector<SensorFrame> frames{Four().frames[0], Four().frames[0]};
    CalibrationResult given;
    given.sensors.resize(2);
    for (std::size_t i = 0; i < 2; ++i) {
      frames[i].name = given.sensors[i].name = i == 0 ? "A" : "B";
      given.sensors[i].status = SensorStatus::kOk;
      given.sensors[i].structure_from_sensor = Pose::Identity();
    }
    frames[1].intrinsics.cx += px;
    given.pairs = {{"A", "B", 0.5, 0.012, 0.005}};
    CalibrationResult better = given;
    better.pairs[0].rms_m = 0.004;
    given.findings.push_back({RigCode::kPairApart, {"A", "B"}, "", ""});
    if (several) {
      given.captures.resize(2);
      given.captures[0].sensors = given.sensors;
      given.sensors.push_back(given.sensors[0]);
      given.sensors.back().name = "C";
    }
    TryHypotheses(
        {"", frames}, Four().structure, CalibrateOptions(), [&](const Capture&) { return better; },
        &given);
    EXPECT_EQ(Find(given, RigCode::kFilesExchanged) != nullptr, px > 3) << px << " " << several;
  }
}

TEST(Hypotheses, ADepthThatStandsForNothingIsNone) {
  std::vector<SensorFrame> frames = Four().frames;
  for (SensorFrame& frame : frames) {
    for (std::size_t i = 0; i < frame.depth.size(); ++i) {
      if (i % 7 < 2) frame.depth[i] = 65.535f;
    }
  }
  const CalibrationResult result = CalibrateByShape(frames, Four().structure);
  EXPECT_EQ(result.verdict(), SensorStatus::kOk) << FormatReport(result);
}

// As somebody does who changes width and height of another resolution's intrinsics by hand. What
// most sensors have wrong, the last one is suspected of.
TEST(Hypotheses, AnImplausibleFocalLengthIsTheFirstSuspicion) {
  std::vector<SensorFrame> frames = Four().frames;
  for (SensorFrame& frame : frames) {
    frame.sensor = "azure_kinect_nfov_binned";
    if (frame.name != "S3") frame.intrinsics.fx = frame.intrinsics.fy = 504;
  }
  for (const FrameResult& sensor : CalibrateByShape(frames, Four().structure).sensors) {
    EXPECT_NE(sensor.status, SensorStatus::kOk);
    EXPECT_EQ(sensor.code, SensorCode::kIntrinsicsSuspect) << sensor.reason;
    EXPECT_TRUE(
        Has(sensor.reason, sensor.name == "S3"
                               ? "3 of 4 sensors of this rig have other intrinsics"
                               : "its fx is 504 px, and a azure_kinect_nfov_binned has about "
                                 "252"));
  }
}

// Cropped frames with the intrinsics of whole ones leave residuals as small as right ones.
TEST(Hypotheses, IntrinsicsOfFramesBeforeTheyWereCropped) {
  std::vector<SensorFrame> frames = Four().frames;
  for (SensorFrame& frame : frames) {
    frame.sensor = "azure_kinect_nfov_binned";
    DepthImage part(frame.depth.width() - 40, frame.depth.height() - 20);
    for (const auto [u, v] : Pixels(part)) part(u, v) = frame.depth(u + 40, v + 20);
    frame.depth = part;
    frame.intrinsics.width = part.width();
    frame.intrinsics.height = part.height();
  }
  for (const FrameResult& sensor : CalibrateByShape(frames, Four().structure).sensors) {
    EXPECT_EQ(sensor.code, SensorCode::kIntrinsicsSuspect) << sensor.name << sensor.reason;
    EXPECT_TRUE(Has(sensor.hint, "cut off"));
  }
  for (SensorFrame& frame : frames) {
    frame.intrinsics.cx -= 40;
    frame.intrinsics.cy -= 20;
  }
  for (const FrameResult& sensor : CalibrateByShape(frames, Four().structure).sensors)
    EXPECT_NE(sensor.code, SensorCode::kIntrinsicsSuspect) << sensor.name << sensor.reason;
}

// Means over frames in which depths are missing at times.
TEST(Hypotheses, AFrameThatWasSpoiltIsNoBadView) {
  std::vector<SensorFrame> frames = Four().frames;
  RandomStream random(1, 0, "spoilt");
  for (float& z : frames[0].depth) {
    if (random.Uniform(0, 1) < 0.4) z *= static_cast<float>(random.Uniform(0.2, 0.9));
  }
  const FrameResult sensor = CalibrateByShape(frames, Four().structure).sensors[0];
  EXPECT_NE(sensor.status, SensorStatus::kOk);
  EXPECT_TRUE(Has(sensor.hint, "far from what their neighbours measure"));
}

// A sensor misses depth where it ends before something farther away. One that does not is filled.
TEST(Hypotheses, HolesThatWereFilledAreNamed) {
  std::vector<SensorFrame> frames = Four().frames;
  frames[0].intrinsics.fx *= 1.3;
  frames[0].intrinsics.fy *= 1.3;
  const auto hint = [&] {
    const FrameResult sensor = CalibrateByShape(frames, Four().structure).sensors[0];
    EXPECT_NE(sensor.status, SensorStatus::kOk);
    return sensor.hint;
  };
  EXPECT_EQ(hint().rfind("record frames without filters that fill holes", 0), 0u) << hint();
  DepthImage& depth = frames[0].depth;
  for (const auto [u, v] : Pixels({1, 0}, {depth.width(), depth.height()})) {
    if (std::abs(depth(u, v) - depth(u - 1, v)) > 0.05f) depth(u - 1, v) = 0;
  }
  EXPECT_FALSE(Has(hint(), "fill holes"));
}

}  // namespace
}  // namespace volalign::hypotheses_test
