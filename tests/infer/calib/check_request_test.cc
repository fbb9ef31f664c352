#include "infer/calib/check_request.h"

#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>

#include "tests/core/base/expect_error.h"

namespace volalign::check_request_test {
namespace {

SensorFrame Frame(const std::string& name, float depth) {
  SensorFrame frame;
  frame.name = name;
  frame.depth = DepthImage(4, 3, depth);
  frame.intrinsics.width = 4;
  frame.intrinsics.height = 3;
  frame.intrinsics.fx = frame.intrinsics.fy = 5;
  frame.sensor = "kind";
  return frame;
}

/// Two sensors in two captures, as a calibration may have them.
struct Request {
  std::vector<Capture> captures{{"first", {Frame("A", 1), Frame("B", 2)}},
                                {"second", {Frame("A", 3), Frame("B", 4)}}};
  CalibrateOptions options;
  bool model = true;

  void Measure(std::size_t capture, std::size_t sensor, float depth) {
    captures[capture].frames[sensor].depth = DepthImage(4, 3, depth);
  }
  SensorFrame& OfSecond(std::size_t sensor) { return captures[1].frames[sensor]; }
  void Check() const { CheckRequest(captures, Structure(), options, model); }
};

TEST(CheckRequest, LetsThroughWhatCanBeCalibrated) {
  const std::vector<std::function<void(Request*)>> changes = {
      [](Request*) {},
      [](Request* request) { request->captures.pop_back(); },
      // A sensor may be absent from a capture, and each may see nothing at all there.
      [](Request* request) { request->captures[1].frames.pop_back(); },
      [](Request* request) {
        for (const std::size_t capture : {0, 1}) request->Measure(capture, 0, 0);
      },
      // The same depth map of two sensors is found later, sensor by sensor.
      [](Request* request) { request->Measure(0, 1, 1); },
      [](Request* request) {
        request->model = false;
        request->options.initial.method = PoseMethod::kGeometry;
      },
      [](Request* request) { request->model = false; },
  };
  for (std::size_t i = 0; i < changes.size(); ++i) {
    Request request;
    changes[i](&request);
    EXPECT_NO_THROW(request.Check()) << "case " << i;
  }
}

TEST(CheckRequest, NamesWhatIsWrongWithTheFrames) {
  struct Case {
    std::function<void(Request*)> change;
    std::vector<std::string> words;
  };
  const std::vector<Case> cases = {
      {[](Request* request) { request->captures.clear(); }, {"no capture"}},
      {[](Request* request) { request->captures[1].name = "first"; }, {"captures", "\"first\""}},
      {[](Request* request) { request->OfSecond(1).name = "A"; }, {"sensors", "\"A\""}},
      {[](Request* request) { request->OfSecond(1).intrinsics.fx = 6; },
       {"\"B\"", "intrinsics", "first", "second"}},
      {[](Request* request) { request->OfSecond(0).sensor = "other"; }, {"\"A\"", "kind"}},
      {[](Request* request) {
         request->OfSecond(0).prior = PosePrior{Pose::Identity(), PriorWorld::kStructure, 0.05, 3};
         request->OfSecond(1).prior = PosePrior{Pose::Identity(), PriorWorld::kMetric, 0.05, 3};
       },
       {"\"A\"", "\"B\"", "different worlds"}},
      {[](Request* request) {
         request->OfSecond(0).prior = PosePrior{Pose::Identity(), PriorWorld::kStructure, 0, 3};
       },
       {"\"A\"", "standard deviation of 0"}},
      {[](Request* request) {
         request->OfSecond(1).prior = PosePrior{Pose::Identity(), PriorWorld::kMetric, 0.05, 1e9};
       },
       {"\"B\"", "standard deviation of 1"}},
      {[](Request* request) { request->Measure(1, 1, 2); },
       {"\"B\"", "same depth map", "first", "second"}},
  };
  for (const Case& c : cases) {
    Request request;
    c.change(&request);
    const std::string message = ExpectError<DataError>([&] { request.Check(); });
    for (const std::string& word : c.words) EXPECT_TRUE(Has(message, word));
  }
}

// One measured pixel that is the same in both is enough to show something; one that differs is
// enough to be another frame.
TEST(CheckRequest, ComparesEveryPixel) {
  Request request;
  for (const std::size_t capture : {0, 1}) {
    request.Measure(capture, 0, 0);
    request.captures[capture].frames[0].depth(2, 1) = 1.5f;
  }
  ExpectError<DataError>([&] { request.Check(); });
  request.OfSecond(0).depth(3, 2) = 1;
  EXPECT_NO_THROW(request.Check());
}

TEST(CheckRequest, ComparesEveryTwoCaptures) {
  Request request;
  request.captures.push_back(request.captures[1]);
  request.captures[2].name = "third";
  ExpectError<DataError>([&] { request.Check(); }, {"in third as in second"});
}

TEST(CheckRequest, NamesWhatIsWrongWithTheOptions) {
  Request request;
  request.options.initial.method = PoseMethod::kNetwork;
  EXPECT_NO_THROW(request.Check());
  request.model = false;
  ExpectError<ConfigError>([&] { request.Check(); }, {"no model"});
  Request estimate;
  estimate.options.refine.estimate = "boxes, weather";
  ExpectError<ConfigError>([&] { estimate.Check(); }, {"weather"});
  Request range;
  range.options.threads = 0;
  ExpectError<ConfigError>([&] { range.Check(); }, {"threads"});
}

}  // namespace
}  // namespace volalign::check_request_test
