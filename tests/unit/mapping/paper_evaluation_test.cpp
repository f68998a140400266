#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/paper_evaluation.hpp>

#include <atomic>
#include <fstream>
#include <nlohmann/json.hpp>
#include <numbers>
#include <stdexcept>

#include "evaluation/paper/paper_answers.hpp"
#include "evaluation/paper/paper_pieces.hpp"
#include "evaluation/paper/plain_map.hpp"
#include "small_drive.hpp"

namespace stillmap::mapping {
namespace paper_evaluation_test {

using localization::PoseStatus;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

/// Answers with the prior, so that the error is the prior's.
class Echo : public localization::Aligner {
 public:
  [[nodiscard]] localization::AlignmentResult align(
      const maps::PointCloud& /*scan_lidar*/,
      const std::optional<localization::Prior>& prior) const override {
    localization::AlignmentResult answer;
    answer.status = PoseStatus::kOk;
    answer.T_map_lidar = prior.value().T_map_lidar;
    answer.covariance.setIdentity();
    return answer;
  }
};

/// Streets of four scans, 1 m and 0.02 rad apart, in place of simulated ones.
class PaperEvaluationTest : public ::testing::Test {
 protected:
  PaperEvaluationTest() {
    options_.seeds = {1, 2};
    options_.scans = test::SmallDrive::kScans;
    options_.detector = "boxes";
    options_.maps = {"none", "paper"};
    options_.methods = {"echo"};
    parts_.simulate = [this](const PaperEvaluationOptions&, PaperParts::StreetDay,
                             const std::filesystem::path& target, const ProgressCallback&,
                             const CancelFlag&) {
      ++simulated_;
      const test::TemporaryFolder folder;
      const test::SmallDrive drive;
      std::filesystem::copy(drive.write(folder), target, std::filesystem::copy_options::recursive);
      std::filesystem::copy(drive.write_car(folder), target / "boxes.json");
    };
    parts_.make_aligner = [this](std::string_view, const maps::MapPackage&) {
      ++asked_;
      return std::make_unique<Echo>();
    };
  }

  [[nodiscard]] PaperEvaluation evaluate(bool keep = true) const {
    return evaluate_paper(options_, parts_, folder_.path() / "work", keep, {}, cancel_);
  }
  [[nodiscard]] std::vector<std::filesystem::path> kept(const std::string& kind) const {
    std::vector<std::filesystem::path> found;
    for (const auto& entry : std::filesystem::directory_iterator(folder_.path() / "work" / kind))
      found.push_back(entry.path());
    std::sort(found.begin(), found.end());
    return found;
  }
  void reset() { simulated_ = asked_ = 0; }

  test::TemporaryFolder folder_;
  PaperEvaluationOptions options_;
  PaperParts parts_;
  CancelFlag cancel_{false};
  mutable int simulated_ = 0;
  mutable int asked_ = 0;
};

TEST_F(PaperEvaluationTest, AsksEveryMapOfEveryStreetFromTheScanBefore) {
  std::size_t last = 0, of = 0;
  const PaperEvaluation result = evaluate_paper(
      options_, parts_, folder_.path() / "work", true,
      [&](std::string_view, std::size_t done, std::size_t total) {
        EXPECT_GE(done, last);
        last = done;
        of = total;
      },
      cancel_);
  EXPECT_GT(of, 0U);
  EXPECT_EQ(last, of);
  EXPECT_EQ(simulated_, 4);
  EXPECT_EQ(asked_, 8);
  EXPECT_THAT(result.streets, ElementsAre("seed 1", "seed 2"));
  EXPECT_EQ(result.scans, 6U);
  ASSERT_THAT(result.rows, SizeIs(4));
  EXPECT_EQ(result.rows[0].query, "raw");
  EXPECT_EQ(result.rows[3].query, "removed");
  for (const PaperRow& row : result.rows) {
    EXPECT_NEAR(row.rmse_xy_m.value, 1.0, 1e-3);
    EXPECT_NEAR(row.rmse_yaw_rad.value, 0.02, 1e-6);
    EXPECT_EQ(row.success_rate.value, 0.0);
    const bool paper = row.map == "paper";
    for (const PaperAnswers& street : row.streets) {
      // The paper's map is matched as a plain cloud.
      EXPECT_EQ(street.projected, 0U);
      EXPECT_GT(street.measured, 0U);
      EXPECT_EQ(street.query_deleted > 0, row.query == "removed");
    }
    EXPECT_EQ(row.streets[0].map_digest != result.rows[0].streets[0].map_digest, paper);
  }
  ASSERT_THAT(result.differences, SizeIs(2));
  const nlohmann::json json = nlohmann::json::parse(to_json(result));
  EXPECT_EQ(json["table"].size(), 4U);
  EXPECT_EQ(json["table"][2]["streets"][1]["name"], "seed 2");
  EXPECT_EQ(json["differences"][0]["better_streets"]["of"], 2);
  EXPECT_EQ(json["options"]["detector"], "boxes");
}

TEST_F(PaperEvaluationTest, GoesOnWithWhatIsThere) {
  const std::string first = to_json(evaluate());
  reset();
  auto again = nlohmann::json::parse(to_json(evaluate()));
  EXPECT_EQ(simulated_ + asked_, 0);
  again["seconds"] = nlohmann::json::parse(first)["seconds"];
  EXPECT_EQ(again, nlohmann::json::parse(first));
  // One question more needs its map, which is there, and nothing else.
  std::filesystem::remove(kept("answers").front());
  (void)evaluate();
  EXPECT_EQ(simulated_, 0);
  EXPECT_EQ(asked_, 1);
}

TEST_F(PaperEvaluationTest, MakesBrokenPiecesAgain) {
  options_.seeds = {1};
  const PaperEvaluation first = evaluate();
  reset();
  // Half a file of answers, a map with a damaged tile, a drive without a scan.
  const std::filesystem::path answers = kept("answers").front();
  std::filesystem::resize_file(answers, std::filesystem::file_size(answers) / 2);
  std::filesystem::path tile;
  for (const std::filesystem::path& map : kept("maps")) {
    for (const auto& entry : std::filesystem::recursive_directory_iterator(map)) {
      const auto kind = entry.path().extension();
      if (kind != ".bin" && kind != ".history" && kind != ".pack") continue;
      std::fstream file(entry.path(), std::ios::in | std::ios::out | std::ios::binary);
      file.seekp(8);
      file.put('x');
    }
  }
  std::filesystem::remove(kept("drives").front() / "000002.bin");
  const PaperEvaluation second = evaluate();
  EXPECT_EQ(simulated_, 1);
  EXPECT_EQ(asked_, 1);
  EXPECT_EQ(first.rows[0].streets[0].map_digest, second.rows[0].streets[0].map_digest);
}

TEST_F(PaperEvaluationTest, DoesNotTakePiecesOfAnotherQuestion) {
  options_.seeds = {1};
  options_.maps = {"none"};
  (void)evaluate();
  reset();
  options_.program = "another";
  (void)evaluate();
  EXPECT_EQ(simulated_, 2);
  EXPECT_EQ(asked_, 2);
  reset();
  options_.detector = "geometric";
  (void)evaluate();
  EXPECT_EQ(simulated_, 0);
  // Nothing is detected for the map, nor in raw scans.
  EXPECT_EQ(asked_, 1);
}

TEST_F(PaperEvaluationTest, LeavesAnswersAloneUnlessToldToKeep) {
  options_.maps = {"ours", "ours-all"};
  (void)evaluate(false);
  EXPECT_THAT(kept("maps"), IsEmpty());
  EXPECT_THAT(kept("drives"), IsEmpty());
  EXPECT_THAT(kept("answers"), SizeIs(8));
}

TEST_F(PaperEvaluationTest, TakesDrivesInPairs) {
  const test::TemporaryFolder other;
  const test::SmallDrive drive;
  const std::filesystem::path first = drive.write(folder_), second = drive.write(other);
  std::filesystem::copy(drive.write_car(folder_), second / "boxes.json");
  std::filesystem::copy(drive.write_car(folder_), first / "boxes.json");
  options_.seeds.clear();
  options_.drives = {{first, second}};
  const PaperEvaluation result = evaluate();
  EXPECT_EQ(simulated_, 0);
  EXPECT_THAT(result.streets, ElementsAre("drive 1"));
  EXPECT_EQ(result.scans, 3U);
  // Another scan in the place of one: another drive.
  reset();
  std::filesystem::copy(second / "000001.bin", second / "000003.bin",
                        std::filesystem::copy_options::overwrite_existing);
  (void)evaluate();
  EXPECT_GT(asked_, 0);
}

TEST_F(PaperEvaluationTest, EndsWhenCancelled) {
  cancel_ = true;
  EXPECT_THROW((void)evaluate(), Cancelled);
  EXPECT_THAT(kept("maps"), IsEmpty());
}

TEST_F(PaperEvaluationTest, RefusesWhatMakesNoTable) {
  const auto refused = [&](const auto& change, const std::string& word) {
    PaperEvaluationOptions options = options_;
    change(options);
    std::swap(options, options_);
    try {
      (void)evaluate();
      ADD_FAILURE() << word;
    } catch (const std::invalid_argument& error) {
      EXPECT_THAT(error.what(), HasSubstr(word));
    }
    std::swap(options, options_);
  };
  refused([](auto& options) { options.seeds = {}; }, "seeds");
  refused([](auto& options) { options.seeds = {1, 1}; }, "1 twice");
  refused([](auto& options) { options.methods = {}; }, "methods");
  refused([](auto& options) { options.methods = {"icp", "icp"}; }, "icp twice");
  refused([](auto& options) { options.maps = {"none", "none"}; }, "twice");
  refused([](auto& options) { options.maps = {"magic"}; }, "magic");
  refused([](auto& options) { options.scans = 2; }, "scans: 2");
  refused([](auto& options) { options.threads = -1; }, "threads: -1");
  refused([](auto& options) { options.detector = "magic"; }, "magic");
  refused([](auto& options) { options.detector = "boxes:file"; }, "boxes:file");
  EXPECT_FALSE(std::filesystem::exists(folder_.path() / "work"));
}

TEST(PaperMaps, StandInTheOrderOfTheTable) {
  EXPECT_THAT(paper_map_names({"removert", "erasor"}),
              ElementsAre("none", "deletion", "removert", "erasor", "paper", "ours", "ours-all"));
  const std::vector<PaperMap> maps = paper_maps({"paper", "none"}, {});
  ASSERT_THAT(maps, SizeIs(2));
  EXPECT_EQ(maps[0].name, "none");
  EXPECT_EQ(maps[0].build.projection.policy, MovablePolicy::kKeep);
  EXPECT_EQ(maps[0].build.clean, "none");
  EXPECT_FALSE(maps[0].plain);
  EXPECT_EQ(maps[1].build.projection.ground_height, GroundHeight::kMean);
  EXPECT_EQ(maps[1].build.projection.policy, MovablePolicy::kProject);
  EXPECT_TRUE(maps[1].plain);
  const PaperMap cleaned = paper_maps({"removert"}, {"removert"}).front();
  EXPECT_EQ(cleaned.build.clean, "removert");
  EXPECT_EQ(cleaned.build.projection.policy, MovablePolicy::kKeep);
  EXPECT_THROW((void)paper_maps({"removert"}, {}), std::invalid_argument);
}

TEST(PlainMap, HoldsEveryPointAsMeasured) {
  const test::TemporaryFolder folder;
  const test::SmallDrive drive;
  MapBuildOptions build;
  const std::filesystem::path scans = drive.write(folder);
  build.detector = "boxes:" + drive.write_car(folder).string();
  (void)build_map({scans}, folder.path() / "map", build, {}, CancelFlag(false));
  const auto map = maps::MapPackage::open(folder.path() / "map");
  write_plain_map(*map, folder.path() / "plain");
  const auto plain = maps::MapPackage::open(folder.path() / "plain");
  EXPECT_THAT(plain->verify(), IsEmpty());
  EXPECT_EQ(plain->trajectories().size(), map->trajectories().size());
  std::size_t moved = 0;
  for (const maps::TileEntry& entry : map->tiles()) {
    const auto points = map->tile(entry.id), copies = plain->tile(entry.id);
    ASSERT_EQ(points.size(), copies.size());
    for (std::size_t i = 0; i < points.size(); ++i) {
      EXPECT_EQ(points[i].x, copies[i].x);
      EXPECT_TRUE(maps::is_measured(copies[i].kind));
      EXPECT_EQ(copies[i].object, 0);
      if (!maps::is_measured(points[i].kind)) ++moved;
    }
  }
  EXPECT_GT(moved, 0U);
}

TEST(PaperAnswersFile, ALostAnswerHasItsPriorsError) {
  LocalizationQuery lost;
  lost.scan = 4;
  lost.prior_error = {0.8, 2.0};
  LocalizationQuery found;
  found.scan = 5;
  found.status = PoseStatus::kDegraded;
  found.prior_error = {0.8, 2.0};
  found.error << 0.03, -0.04, 0.1, 0.0, 0.0, -0.01;
  LocalizationEvaluation evaluation;
  evaluation.queries = {{lost, found}};
  evaluation.levels.resize(1);
  const test::TemporaryFolder folder;
  const test::SmallDrive drive;
  const MapBuildOptions defaults;
  (void)build_map({drive.write(folder)}, folder.path() / "map", defaults, {}, CancelFlag(false));
  const PaperAnswers answers =
      paper_answers(evaluation, *maps::MapPackage::open(folder.path() / "map"));
  ASSERT_THAT(answers.scans, SizeIs(2));
  EXPECT_EQ(answers.scans[0].xy_m, 0.8);
  EXPECT_NEAR(answers.scans[0].yaw_rad, 2.0 * std::numbers::pi / 180.0, 1e-12);
  EXPECT_FALSE(answers.scans[0].success);
  EXPECT_NEAR(answers.scans[1].xy_m, 0.05, 1e-12);
  EXPECT_NEAR(answers.scans[1].yaw_rad, 0.01, 1e-12);
  EXPECT_TRUE(answers.scans[1].success);

  const std::filesystem::path file = folder.path() / "answers.json";
  write_answers(file, "key", answers);
  const auto read = read_answers(file, "key");
  ASSERT_TRUE(read);
  ASSERT_THAT(read->scans, SizeIs(2));
  EXPECT_EQ(read->scans[1].xy_m, answers.scans[1].xy_m);
  EXPECT_EQ(read->scans[1].status, PoseStatus::kDegraded);
  EXPECT_EQ(read->map_digest, answers.map_digest);
  EXPECT_FALSE(read_answers(file, "another"));
  EXPECT_FALSE(read_answers(folder.path() / "nowhere", "key"));
  EXPECT_FALSE(read_answers(folder.write("broken", "{\"key\": \"key\"}"), "key"));
}

}  // namespace paper_evaluation_test
}  // namespace stillmap::mapping
