#include "core/config/config.h"

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <array>
#include <limits>
#include <string>
#include <vector>

#include "core/base/file_limits.h"
#include "core/base/input_file.h"
#include "core/config/bounded_yaml.h"
#include "tests/core/base/expect_error.h"
#include "tests/core/base/temp_folder.h"

namespace volalign::config_test {
namespace {

struct SensorConfig {
  std::string name = "sensor";
  double rho_cm = 200;
  std::array<double, 3> look_at_cm{0, 0, 0};
  std::vector<std::string> tags;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("name", name, "its name");
    ar("rho_cm", rho_cm, "distance", Above(0));
    ar("look_at_cm", look_at_cm, "point in the middle of the image");
    ar("tags", tags, "words");
  }
};

struct TrainConfig {
  double lr = 2e-4;
  std::array<double, 2> betas{0.9, 0.99};
  int batch = 16;
  std::int64_t samples = 3200000;
  bool resume = false;
  std::string schedule = "constant";

  template <class Archive>
  void Describe(Archive& ar) {
    ar("lr", lr, "initial learning rate", Above(0));
    ar("betas", betas, "Adam's decay rates", AtLeast(0), Between(0, 0.999));
    ar("batch", batch, "samples a step", AtLeast(1));
    ar("samples", samples, "samples of the whole run", AtLeast(0));
    ar("resume", resume, "continue | start again");
    ar("schedule", schedule, "of the learning rate", OneOf({"constant", "one_cycle"}));
  }
};

struct Config {
  std::string name = "run";
  TrainConfig train;
  std::vector<int> roll_offsets_deg{90};
  std::vector<std::string> words;
  std::vector<SensorConfig> sensors;
  float scale = 0.1f;
  std::uint8_t small = 7;

  template <class Archive>
  void Describe(Archive& ar) {
    ar("name", name, "of the run");
    ar("train", train, "training");
    ar("roll_offsets_deg", roll_offsets_deg, "mounting offsets", Between(-360, 360));
    ar("words", words, "any text");
    ar("sensors", sensors, "the rig");
    ar("scale", scale, "a float");
    ar("small", small, "8 bits");
  }
};

Config FromText(const std::string& text) {
  return ReadConfig<Config>(ConfigSource::FromString(text, "a.yaml"));
}

void ExpectBad(const std::string& text, std::initializer_list<std::string> parts) {
  SCOPED_TRACE(text);
  ExpectError<ConfigError>([&] { FromText(text); }, parts);
}

TEST(ReadConfig, DefaultsStayWhereNothingIsSaid) {
  for (const char* text : {"", "# only a comment\n", "{}", "train: {}\n"}) {
    const Config config = FromText(text);
    EXPECT_EQ(config.name, "run");
    EXPECT_EQ(config.train.lr, 2e-4);
    EXPECT_EQ(config.train.betas, (std::array<double, 2>{0.9, 0.99}));
    EXPECT_EQ(config.roll_offsets_deg, std::vector<int>{90});
    EXPECT_TRUE(config.sensors.empty());
  }
}

TEST(ReadConfig, ReadsEveryType) {
  const Config config = FromText(
      "name: m01\n"
      "train:\n"
      "  lr: 1e-3\n"
      "  betas: [0.5, .75]\n"
      "  batch: +4\n"
      "  samples: 3.2e6\n"
      "  resume: yes\n"
      "  schedule: one_cycle\n"
      "roll_offsets_deg: [0, -90, 180]\n"
      "words: [plain, \"with: colon\", 'a # b', \"7\", true]\n"
      "sensors:\n"
      "  - {name: KA03, rho_cm: 150}\n"
      "  - name: KA04\n"
      "    look_at_cm: [1, 2, 3]\n"
      "    tags: []\n"
      "scale: 0.1\n");
  EXPECT_EQ(config.name, "m01");
  EXPECT_EQ(config.train.lr, 1e-3);
  EXPECT_EQ(config.train.betas, (std::array<double, 2>{0.5, 0.75}));
  EXPECT_EQ(config.train.batch, 4);
  EXPECT_EQ(config.train.samples, 3200000);
  EXPECT_TRUE(config.train.resume);
  EXPECT_EQ(config.train.schedule, "one_cycle");
  EXPECT_EQ(config.roll_offsets_deg, (std::vector<int>{0, -90, 180}));
  EXPECT_EQ(config.words, (std::vector<std::string>{"plain", "with: colon", "a # b", "7", "true"}));
  ASSERT_EQ(config.sensors.size(), 2u);
  EXPECT_EQ(config.sensors[0].name, "KA03");
  EXPECT_EQ(config.sensors[0].rho_cm, 150);
  EXPECT_EQ(config.sensors[1].name, "KA04");
  EXPECT_EQ(config.sensors[1].rho_cm, 200);
  EXPECT_EQ(config.sensors[1].look_at_cm, (std::array<double, 3>{1, 2, 3}));
  EXPECT_EQ(config.scale, 0.1f);
}

TEST(ReadConfig, UnknownKeysNamePlaceAndNearestKey) {
  ExpectBad("train:\n  batch: 4\n  lrr: 1e-3\n",
            {"'train.lrr'", "a.yaml:3", "did you mean 'train.lr'?"});
  ExpectBad("nmae: x\n", {"'nmae'", "a.yaml:1", "did you mean 'name'?"});
  ExpectBad("lr: 1\n", {"'lr'", "did you mean 'train.lr'?"});  // the wrong level
  ExpectBad("sensors:\n  - {name: a}\n  - {nam: b}\n",
            {"'sensors[1].nam'", "a.yaml:3", "did you mean 'sensors[1].name'?"});
  ExpectBad("sensers: [{name: a}]\n", {"'sensers[0].name'", "did you mean 'sensors'?"});
  ExpectBad("train: {batch: {size: 3}}\n",
            {"train.batch = {size: 3} is not a single value", "a.yaml:1"});
  ExpectBad("inherits: b.yaml\n", {"'inherits'"});  // only a file has a folder to look in
  ExpectBad("train: {size: 3}\n", {"'train.size'", "; train has batch, betas, lr, "});
  EXPECT_FALSE(Has(ExpectError<ConfigError>([] { FromText("qqqqqqqqqqqqqqqqqqqqqq: 1\n"); }),
                   "did you mean"));
}

TEST(ReadConfig, ItemsOfAListAreNumberedWithoutAGap) {
  const auto expect_bad = [](const std::string& key, std::initializer_list<std::string> parts) {
    SCOPED_TRACE(key);
    ConfigSource source = ConfigSource::FromString("sensors: [{name: a}]\n", "a.yaml");
    ExpectError<ConfigError>([&] { source.Set(key + "=x"); }, parts);
  };
  expect_bad("sensors[2].name", {"sensors[2].name", "the next item of its list is [1]", "--set"});
  expect_bad("sensors[].name", {"sensors[].name", "the next item of its list is [1]"});
  expect_bad("sensors[-1].name", {"sensors[-1].name", "the next item of its list is [1]"});
  expect_bad("sensors[1x].name", {"sensors[1x].name", "the next item of its list is [1]"});
  expect_bad("sensors[0]..name", {"sensors[0]..name", "groups have keys"});
  expect_bad("sensors.name", {"sensors.name", "the next item of its list is [1]"});
  // Memory is taken for items that are there, not for what an index says.
  for (const char* index : {"999999999", "18446744073709551615", "99999999999999999999999"}) {
    const std::string key = "sensors[" + std::string(index) + "].name";
    expect_bad(key, {key});
  }
  ConfigSource twelve = ConfigSource::FromString("sensors: [{name: a}]\n", "a.yaml");
  for (int i = 1; i < 12; ++i) twelve.Set("sensors[" + std::to_string(i) + "].name=x");
  EXPECT_EQ(ReadConfig<Config>(twelve).sensors.size(), 12u);
}

struct Renamed {
  struct Inner {
    double depth = 1;
    template <class Archive>
    void Describe(Archive& ar) {
      ar("depth", depth, "depth", AtLeast(0), FormerlyNamed("deep"));
    }
  };
  int width = 1;
  Inner inner;
  std::vector<Inner> list;
  template <class Archive>
  void Describe(Archive& ar) {
    ar("width", width, "width", FormerlyNamed("wide"),
       Removed("height", "width is both", std::vector<std::string>{"1"}), Fixed("group.length", 2));
    ar("inner", inner, "inner", FormerlyNamed("in"));
    ar("list", list, "list", FormerlyNamed("items"));
  }
};

struct NoDefault {
  double reach = 0;
  template <class Archive>
  void Describe(Archive& ar) {
    ar("reach", reach, "its default violates this", Above(0));
  }
};

TEST(ReadConfig, AMisspeltKeyIsNamedBeforeADefaultThatMayNotStay) {
  const auto expect = [](const char* yaml, std::initializer_list<std::string> parts) {
    ExpectError<ConfigError>(
        [&] { ReadConfig<NoDefault>(ConfigSource::FromString(yaml, "a.yaml")); }, parts);
  };
  expect("reech: 3\n", {"'reech' (a.yaml:1)", "did you mean 'reach'?"});
  expect("", {"reach = 0 violates reach > 0 (default)"});
}

TEST(ReadConfig, AFormerNameIsReadWithAWarning) {
  ::testing::internal::CaptureStderr();
  const auto config = ReadConfig<Renamed>(ConfigSource::FromString(
      "wide: 3\nin: {deep: 4}\nitems: [{deep: 5}, {depth: 6}]\n", "a.yaml"));
  const std::string warnings = ::testing::internal::GetCapturedStderr();
  EXPECT_EQ(config.width, 3);
  EXPECT_EQ(config.inner.depth, 4);
  ASSERT_EQ(config.list.size(), 2U);
  EXPECT_EQ(config.list[0].depth, 5);
  EXPECT_EQ(config.list[1].depth, 6);
  EXPECT_TRUE(Has(warnings, "warning: wide (a.yaml:1) is now called width\n",
                  "warning: in (a.yaml:2) is now called inner\n",
                  "warning: in.deep (a.yaml:2) is now called in.depth\n"));
  // What was saved of a configuration is read again without another warning.
  ::testing::internal::CaptureStderr();
  ReadConfig<Renamed>(ConfigSource::FromString("wide: 3\n", "a saved one"));
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  ExpectError<ConfigError>(
      [] { ReadConfig<Renamed>(ConfigSource::FromString("wide: 3\nwidth: 4\n", "a.yaml")); },
      {"wide (a.yaml:1) is the former name of width (a.yaml:2)"});
  // Neither written nor documented, and no prefix of another key counts.
  EXPECT_FALSE(Has(WriteConfig(config), "wide"));
  EXPECT_FALSE(Has(DocumentConfig<Renamed>(), "wide"));
  EXPECT_THROW(ReadConfig<Renamed>(ConfigSource::FromString("wider: 3\n", "a.yaml")), ConfigError);
}

TEST(ReadConfig, AKeyThatIsGoneSaysWhatDoesItsWork) {
  ExpectError<ConfigError>(
      [] { ReadConfig<Renamed>(ConfigSource::FromString("height: 3\n", "a.yaml")); },
      {"height (a.yaml:1) is no longer a key: width is both"});
  ExpectError<ConfigError>(
      [] { ReadConfig<Renamed>(ConfigSource::FromString("group: {length: 3}\n", "a.yaml")); },
      {"group.length (a.yaml:1) is no longer a key: it is 2 now"});
  EXPECT_EQ(
      ReadConfig<Renamed>(ConfigSource::FromString("group: {length: 2}\nwidth: 2\n", "a.yaml"))
          .width,
      2);
  // With the value of saved configurations in which it had no effect, it is passed over.
  EXPECT_EQ(ReadConfig<Renamed>(ConfigSource::FromString("height: 1\nwidth: 2\n", "a.yaml")).width,
            2);
  EXPECT_FALSE(Has(DocumentConfig<Renamed>(), "both"));
}

TEST(NearestKey, GoesByEditDistance) {
  EXPECT_EQ(NearestKey("kitten", {"sitting", "mitten", "xyz"}), "mitten");
  EXPECT_EQ(NearestKey("train.lambda", {"train.lr", "loss.lambda", "train.lambada"}),
            "loss.lambda");
  EXPECT_EQ(NearestKey("abc", {}), "");
  // A word of a key is enough; the group alone is not.
  EXPECT_EQ(NearestKey("chanels", {"model.base_channels", "model.kind"}), "model.base_channels");
  EXPECT_EQ(NearestKey("chanels", {"model.base_channels", "run.channels_last", "run.seed"}),
            "model.base_channels' or 'run.channels_last");
  EXPECT_EQ(NearestKey("model.width", {"loss.min_side_pixels", "model.kind"}), "");
  EXPECT_EQ(NearestKey("abc", {"uvwxyz"}), "");
  // Not of a key of a megabyte.
  EXPECT_EQ(NearestKey(std::string(1 << 20, 'a'), {std::string(1 << 20, 'a') + "b"}), "");
}

TEST(ReadConfig, DuplicateKeysAreErrors) {
  ExpectBad("name: a\ntrain: {}\nname: b\n", {"'name'", "twice", "a.yaml:3"});
  ExpectBad("train:\n  lr: 1\n  lr: 2\n", {"'train.lr'", "twice", "a.yaml:3"});
  ExpectBad("train: {lr: 1}\ntrain: {batch: 2}\n", {"'train'", "twice", "a.yaml:2"});
  ExpectBad("train: {batch: 2}\ntrain: {lr: 1}\n", {"'train'", "twice", "a.yaml:2"});
  ExpectBad("sensors:\n  - {name: a}\nsensors:\n  - {rho_cm: 3}\n",
            {"'sensors'", "twice", "a.yaml:3"});
  ExpectBad("train: {lr: 1}\ntrain.lr: 2\n", {"'train.lr'", "twice", "a.yaml:2"});
}

TEST(ReadConfig, WrongTypesNameKeyValueAndPlace) {
  ExpectBad("train:\n  lr: fast\n", {"train.lr = 'fast'", "number", "a.yaml:2"});
  ExpectBad("train:\n  lr: 1e-3x\n", {"train.lr = '1e-3x'", "a.yaml:2"});
  ExpectBad("train:\n  lr: .nan\n", {"train.lr", "a.yaml:2"});
  ExpectBad("train:\n  lr: +-1\n", {"train.lr = '+-1'", "number", "a.yaml:2"});
  ExpectBad("train:\n  lr: 1e999\n", {"train.lr", "a.yaml:2"});
  ExpectBad("train:\n  lr:\n", {"'train.lr'", "no value", "a.yaml:2"});
  ExpectBad("train:\n  lr: ''\n", {"train.lr", "a.yaml:2"});
  ExpectBad("train:\n  lr: [1, 2]\n", {"train.lr", "single value", "a.yaml:2"});
  ExpectBad("train:\n  batch: 1.5\n", {"train.batch = '1.5'", "whole number", "a.yaml:2"});
  ExpectBad("train:\n  batch: four\n", {"train.batch = 'four'", "a.yaml:2"});
  ExpectBad("train:\n  resume: 2\n", {"train.resume = '2'", "true or false", "a.yaml:2"});
  for (const char* one : {"0.9", "[0.9]"})
    ExpectBad("train:\n  betas: " + std::string(one) + "\n",
              {"train.betas", "1 values", "2 are expected", "a.yaml:2"});
  ExpectBad("train:\n  betas: [0.9, x]\n", {"train.betas[1] = 'x'", "a.yaml:2"});
  ExpectBad("train: 5\n", {"train = '5' is not a map", "a.yaml:1"});
  ExpectBad("train: [1, 2]\n", {"train = [1, 2] is not a map", "a.yaml:1"});
  EXPECT_EQ(FromText("roll_offsets_deg: -90\n").roll_offsets_deg, std::vector<int>{-90});
  ExpectBad("roll_offsets_deg: [[1, 2]]\n",
            {"roll_offsets_deg[0] = [1, 2] is not a single value", "a.yaml:1"});
  ExpectBad("roll_offsets_deg: [1, {a: 2}]\n",
            {"roll_offsets_deg[1] = {a: 2} is not a single value", "a.yaml:1"});
  ExpectBad("sensors: 5\n", {"sensors[0] = '5' is not a map", "a.yaml:1"});
  ExpectBad("sensors: [a, b]\n", {"sensors[0] = 'a' is not a map", "a.yaml:1"});
  ExpectBad("sensors: {name: a}\n", {"sensors = {name: a} is not a list", "a.yaml:1"});
  ExpectBad("name: {first: a}\n", {"name = {first: a} is not a single value", "a.yaml:1"});
}

// Silently wrapped numbers would be worse than none.
TEST(ReadConfig, NumbersHaveToFitTheirType) {
  EXPECT_EQ(FromText("train: {batch: 2147483647}\n").train.batch, 2147483647);
  ExpectBad("train:\n  batch: 2147483648\n", {"train.batch = '2147483648'", "a.yaml:2"});
  ExpectBad("train:\n  batch: 4294967297\n", {"train.batch = '4294967297'", "a.yaml:2"});
  EXPECT_EQ(FromText("train: {samples: 9000000000000000001}\n").train.samples, 9000000000000000001);
  ExpectBad("train:\n  samples: 9300000000000000000\n", {"train.samples", "a.yaml:2"});
  EXPECT_EQ(FromText("small: 255\n").small, 255);
  ExpectBad("small: 256\n", {"small = '256' is not a whole number in [0, 255]", "a.yaml:1"});
  ExpectBad("small: -1\n", {"small = '-1'", "a.yaml:1"});
}

TEST(ReadConfig, ViolatedConstraintsAreNamedAsInTheHouseStyle) {
  EXPECT_EQ(ExpectError<ConfigError>([] { FromText("name: x\ntrain:\n  lr: 0\n"); }),
            "train.lr = 0 violates train.lr > 0 (a.yaml:3)");
  ExpectBad("train: {batch: 0}\n", {"train.batch = 0 violates train.batch >= 1"});
  ExpectBad("train: {betas: [0.9, 0.9995]}\n",
            {"train.betas[1] = 0.9995 violates train.betas[1] in [0, 0.999]"});
  ExpectBad("train: {betas: [-0.1, 0.9]}\n",
            {"train.betas[0] = -0.1 violates train.betas[0] >= 0"});
  ExpectBad(
      "train: {schedule: cosine}\n",
      {"train.schedule = cosine violates train.schedule in {constant, one_cycle}", "a.yaml:1"});
  ExpectBad("roll_offsets_deg: [0, 400]\n", {"roll_offsets_deg[1] = 400", "[-360, 360]"});
  ExpectBad("sensors:\n  - {rho_cm: 100}\n  - {rho_cm: -1}\n",
            {"sensors[1].rho_cm = -1", "a.yaml:3"});
  // The borders themselves.
  FromText("train: {batch: 1, betas: [0, 0.999]}\nroll_offsets_deg: [-360, 360]\n");
}

TEST(ValidateConfig, ChecksStructsFilledInCode) {
  Config config;
  ValidateConfig(config);
  config.train.lr = -1;
  ExpectError<ConfigError>([&] { ValidateConfig(config); },
                           {"train.lr = -1 violates train.lr > 0"});
  config.train.lr = std::numeric_limits<double>::quiet_NaN();
  ExpectError<ConfigError>([&] { ValidateConfig(config); }, {"train.lr"});
  config = Config();
  config.sensors.resize(2);
  config.sensors[1].rho_cm = 0;
  ExpectError<ConfigError>([&] { ValidateConfig(config); }, {"sensors[1].rho_cm = 0"});
}

TEST(ConfigSource, BadYamlNamesFileAndLine) {
  ExpectBad("name: [1, 2\n", {"a.yaml:"});
  ExpectBad("name: x\n\t- y\n", {"a.yaml:2"});
  ExpectBad("- a\n- b\n", {"a.yaml", "map"});
  ExpectBad("just words\n", {"a.yaml", "map"});
  ExpectBad("name: *nowhere\n", {"a.yaml:1"});
  for (const char* key : {"? [a, b]\n:", "'':", "'train..lr':", "'sensors[0].name':"})
    ExpectBad(std::string(key) + " 3\n", {"a.yaml:1", "a key has to be a word"});
  ExpectBad("train: &x\n  again: *x\n", {"a.yaml", "nested"});
}

TEST(ConfigSource, SetOverridesTheFile) {
  ConfigSource source =
      ConfigSource::FromString("train: {lr: 1}\nsensors: [{name: a}, {name: b}]\n", "a.yaml");
  source.Set("train.lr=1e-3");
  source.Set("train.betas=[0.1, 0.2]");
  source.Set("name=\"a b\"");
  source.Set("words=[\"x=y\", z]");
  source.Set("sensors[1].name=c");
  const Config config = ReadConfig<Config>(source);
  EXPECT_EQ(config.train.lr, 1e-3);
  EXPECT_EQ(config.train.betas, (std::array<double, 2>{0.1, 0.2}));
  EXPECT_EQ(config.name, "a b");
  EXPECT_EQ(config.words, (std::vector<std::string>{"x=y", "z"}));
  ASSERT_EQ(config.sensors.size(), 2u);
  EXPECT_EQ(config.sensors[0].name, "a");
  EXPECT_EQ(config.sensors[1].name, "c");
  source.Set("sensors=[]");
  EXPECT_TRUE(ReadConfig<Config>(source).sensors.empty());
  source.Set("sensors[0].name=d");
  EXPECT_EQ(ReadConfig<Config>(source).sensors.at(0).name, "d");
  source.Set("sensors=[{name: e}, {name: f, rho_cm: 3}]");
  source.Set("train={lr: 0.5}");
  EXPECT_EQ(ReadConfig<Config>(source).sensors.at(1).rho_cm, 3);
  EXPECT_EQ(ReadConfig<Config>(source).train.lr, 0.5);
  EXPECT_EQ(ReadConfig<Config>(source).train.betas, (std::array<double, 2>{0.1, 0.2}));
}

TEST(ConfigSource, OnlySomeKeys) {
  ConfigSource source = ConfigSource::FromString("train: {lr: 0.5}\ntrainer: {x: 1}\n", "a.yaml");
  source = source.Only({"train."});
  EXPECT_EQ(ReadConfig<Config>(source).train.lr, 0.5);
  EXPECT_EQ(source.Leaves().size(), 1u);
}

TEST(ConfigSource, SetErrors) {
  const auto expect_bad = [](const std::string& assignment,
                             std::initializer_list<std::string> parts,
                             const std::string& place = "--set") {
    SCOPED_TRACE(assignment);
    ExpectError<ConfigError>(
        [&] {
          ConfigSource source;
          source.Set(assignment, place);
          ReadConfig<Config>(source);
        },
        parts);
  };
  expect_bad("train.lr", {"--set train.lr", "KEY=VALUE"});
  expect_bad("=3", {"--set =3"});
  expect_bad("", {"--set"});
  expect_bad("train.lr=", {"--set train.lr="});
  expect_bad("train.lr={a: 1}", {"train.lr = {a: 1} is not a single value", "(--set)"});
  expect_bad("train.lr=~", {"--set train.lr=~", "no value"});
  expect_bad("train.betas=[1", {"--set train.betas=[1"});
  expect_bad("train.betas=[[1, 2]]", {"--set"});
  expect_bad("train.lrr=1", {"'train.lrr'", "(--set)", "'train.lr'"});
  expect_bad("train.lr=0", {"train.lr = 0 violates train.lr > 0 (--set)"});
  expect_bad("train.lr=0", {"train.lr = 0 violates train.lr > 0 (argument)"}, "argument");
  expect_bad("train.lr", {"argument train.lr"}, "argument");
}

class ConfigFiles : public testing::Test {
 protected:
  std::string Write(const std::string& name, const std::string& text) {
    std::filesystem::create_directories((folder_ / name).parent_path());
    return folder_.Write(name, text).string();
  }
  TempFolder folder_;
};

TEST_F(ConfigFiles, InheritsLeafByLeaf) {
  Write("base/root.yaml",
        "name: root\ntrain: {lr: 1, batch: 2}\nroll_offsets_deg: [1, 2, 3]\n"
        "sensors:\n  - {name: a, rho_cm: 1}\n  - {name: b}\n");
  Write("base/middle.yaml", "inherits: root.yaml\ntrain:\n  batch: 3\n  schedule: one_cycle\n");
  const std::string leaf = Write("leaf.yaml",
                                 "inherits: base/middle.yaml\nname: leaf\nroll_offsets_deg: [4]\n"
                                 "sensors:\n  - {name: c}\n");
  const Config config = ReadConfig<Config>(ConfigSource::FromFile(leaf));
  EXPECT_EQ(config.name, "leaf");
  EXPECT_EQ(config.train.lr, 1);
  EXPECT_EQ(config.train.batch, 3);
  EXPECT_EQ(config.train.schedule, "one_cycle");
  EXPECT_EQ(config.roll_offsets_deg, std::vector<int>{4});
  ASSERT_EQ(config.sensors.size(), 1u);  // a list is replaced as a whole
  EXPECT_EQ(config.sensors[0].name, "c");
  EXPECT_EQ(config.sensors[0].rho_cm, 200);
}

TEST_F(ConfigFiles, OfSeveralInheritedFilesTheLaterWins) {
  Write("root.yaml", "name: root\ntrain: {lr: 1, batch: 2}\n");
  Write("a.yaml", "inherits: root.yaml\ntrain: {lr: 3, schedule: one_cycle}\n");
  Write("b.yaml", "inherits: root.yaml\ntrain: {batch: 4}\n");
  const std::string both = Write("both.yaml", "inherits: [a.yaml, b.yaml]\nname: both\n");
  const Config config = ReadConfig<Config>(ConfigSource::FromFile(both));
  EXPECT_EQ(config.name, "both");
  EXPECT_EQ(config.train.lr, 1);  // b.yaml has it from root.yaml
  EXPECT_EQ(config.train.batch, 4);
  EXPECT_EQ(config.train.schedule, "one_cycle");
  // Where it is not beside the file, as with an installed program.
  const std::string before = DataFolder();
  SetDataFolder(folder_.path().string());
  const std::string below = Write("elsewhere/below.yaml", "inherits: base/shared.yaml\n");
  EXPECT_THROW(ConfigSource::FromFile(below), IoError);
  Write("base/shared.yaml", "name: shared\n");
  EXPECT_EQ(ReadConfig<Config>(ConfigSource::FromFile(below)).name, "shared");
  SetDataFolder(before);
}

TEST_F(ConfigFiles, AnEmptyListReplacesAnInheritedOne) {
  Write("root.yaml", "sensors:\n  - {name: a}\n  - {name: b}\nroll_offsets_deg: [1]\n");
  const std::string empty =
      Write("leaf.yaml", "inherits: root.yaml\nsensors: []\nroll_offsets_deg: []\n");
  const Config config = ReadConfig<Config>(ConfigSource::FromFile(empty));
  EXPECT_TRUE(config.sensors.empty());
  EXPECT_TRUE(config.roll_offsets_deg.empty());
  const std::string again = Write("again.yaml", "inherits: leaf.yaml\nsensors: [{tags: [x]}]\n");
  EXPECT_EQ(ReadConfig<Config>(ConfigSource::FromFile(again)).sensors.at(0).tags,
            std::vector<std::string>{"x"});
}

TEST_F(ConfigFiles, BadInheritance) {
  const std::string endless = Write("endless.yaml", "inherits: " + std::string(10000, 'a') + "\n");
  EXPECT_LT(ExpectError<IoError>([&] { ConfigSource::FromFile(endless); }).size(), 700u)
      << "no more of a path";
  Write("root.yaml", "train:\n  lr: 0\n");
  const std::string leaf = Write("leaf.yaml", "inherits: root.yaml\n");
  ExpectError<ConfigError>([&] { ReadConfig<Config>(ConfigSource::FromFile(leaf)); },
                           {"train.lr = 0", "root.yaml:2"});
  Write("a.yaml", "inherits: b.yaml\n");
  Write("b.yaml", "inherits: ./c.yaml\n");
  Write("c.yaml", "inherits: a.yaml\n");
  ExpectError<ConfigError>([&] { ConfigSource::FromFile((folder_ / "a.yaml").string()); },
                           {"a.yaml", "inherits"});
  const std::string self = Write("self.yaml", "inherits: self.yaml\n");
  ExpectError<ConfigError>([&] { ConfigSource::FromFile(self); }, {"self.yaml", "inherits"});
  const std::string missing = Write("missing.yaml", "inherits: nowhere.yaml\n");
  ExpectError<IoError>([&] { ConfigSource::FromFile(missing); }, {"nowhere.yaml"});
  const std::string none = Write("none.yaml", "inherits: []\n");
  ExpectError<ConfigError>([&] { ConfigSource::FromFile(none); }, {"inherits", "none.yaml:1"});
  ExpectError<IoError>([&] { ConfigSource::FromFile((folder_ / "gone.yaml").string()); },
                       {"gone.yaml"});
}

Config Unusual() {
  Config config;
  config.name = "x: \"quoted\" # 'not a comment'\n\ttab, \\ and {braces}";
  config.train.lr = 1.0 / 3;
  config.train.betas = {0.1 + 0.2, 1e-300};
  config.train.samples = 9007199254740993;  // 2^53 + 1
  config.train.resume = true;
  config.roll_offsets_deg = {};
  config.words = {"", " ", "true", "7", "~", "- a", "a: b", "[x]", "*x", "ümläut", "\x01"};
  config.sensors.resize(2);
  config.sensors[0].name = "first: one";
  config.sensors[0].tags = {"a, b", "]"};
  config.sensors[1].rho_cm = 0.1;
  config.sensors[1].look_at_cm = {-1e-9, 0, 1e22};
  config.scale = 0.3f;
  return config;
}

TEST(WriteConfig, ReadsBackEqual) {
  for (const Config& config : {Unusual(), Config()}) {
    const std::string text = WriteConfig(config);
    // Over other defaults: everything, empty lists included, has to come from the text.
    Config start;
    start.words = {"old"};
    start.sensors.resize(5);
    start.sensors[4].tags = {"old"};
    const Config read = ReadConfig<Config>(ConfigSource::FromString(text, "written"), start);
    EXPECT_EQ(WriteConfig(read), text);
    EXPECT_EQ(read.train.samples, config.train.samples);
    EXPECT_EQ(read.words, config.words);
  }
}

// DocumentConfig: docs/config.md, which tests/cli/command_line.py compares.

/// Ten keys, of which each has ten aliases of the one before it: 10^10 values in 499 bytes.
std::string Laughs(const std::string& begin, const std::string& item, const std::string& end) {
  std::string text = "a0: &a0 1\n";
  for (int level = 1; level <= 10; ++level) {
    text += "a" + std::to_string(level) + ": &a" + std::to_string(level) + " " + begin;
    for (int i = 0; i < 10; ++i) {
      if (i > 0) text += ", ";
      text +=
          (item.empty() ? "" : item + std::to_string(i) + ": ") + "*a" + std::to_string(level - 1);
    }
    text += end + "\n";
  }
  return text;
}

std::string Nested(int levels) {
  return std::string(static_cast<std::size_t>(levels), '[') +
         std::string(static_cast<std::size_t>(levels), ']');
}

TEST(LoadYaml, CountsWhatSymmetriesStandFor) {
  ExpectError<YAML::ParserException>([] { LoadYaml(Laughs("[", "", "]")); }, {"1000000", "alias"});
  ExpectError<YAML::ParserException>([] { LoadYaml(Laughs("{", "k", "}")); }, {"1000000", "alias"});
  EXPECT_EQ(LoadYaml("a: &a [1, 2]\nb: *a")["b"][1].as<int>(), 2);
  ExpectError<ConfigError>([] { ConfigSource::FromString(Laughs("{", "k", "}"), "a.yaml"); },
                           {"a.yaml:", "1000000"});
}

TEST(LoadYaml, LimitsDepthAndSize) {
  EXPECT_EQ(LoadYaml(Nested(kMaxYamlDepth)).size(), 1u);
  for (const int levels : {kMaxYamlDepth + 2, 200'000})
    ExpectError<YAML::ParserException>([&] { LoadYaml(Nested(levels)); }, {"64 levels"});
  ExpectError<YAML::ParserException>([] { LoadYaml("a: &a [*a]"); }, {"64 levels"});
  ExpectError<YAML::ParserException>([] { LoadYaml(std::string(kMaxTextBytes + 1, ' ')); },
                                     {"bytes"});
}

TEST(LoadYaml, ReadsOneDocumentAndSaysSo) {
  EXPECT_EQ(LoadYaml("---\na: 1\n...\n")["a"].as<int>(), 1);
  EXPECT_TRUE(LoadYaml("").IsNull());
  ExpectError<YAML::ParserException>([] { LoadYaml("a: 1\n---\na: 2\n"); },
                                     {"line 3", "second document"});
  EXPECT_EQ(LoadYaml("a: 1\n---\na: 2\n", YamlDocuments::kFirst)["a"].as<int>(), 1);
}

TEST(YamlTree, HasNumbersOutsideOfQuotes) {
  const nlohmann::json tree =
      YamlTree("a: [1, -2.5e3, '3', .inf, True]\n'b.c[0]': {d: ~, e: x}\n---\nf: 1\n", "name");
  EXPECT_EQ(tree,
            nlohmann::json::parse(
                R"({"a": [1.0, -2500.0, "3", ".inf", "True"], "b.c[0]": {"d": null, "e": "x"}})"));
}

TEST(YamlTree, NamesFileAndLine) {
  ExpectError<DataError>([] { YamlTree("a: 1\nb: [2", "file"); }, {"file: line 2: "});
  ExpectError<DataError>([] { YamlTree("a: 1\na: 2", "file"); }, {"file: line 2: ", "twice"});
  ExpectError<DataError>([] { YamlTree(Laughs("[", "", "]"), "file"); }, {"file: ", "1000000"});
}

}  // namespace
}  // namespace volalign::config_test
