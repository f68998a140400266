#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <stillmap/mapping/progress_lines.hpp>

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace stillmap::mapping {
namespace progress_lines_test {

using ::testing::DoubleNear;
using ::testing::ElementsAre;
using ::testing::SizeIs;

/// Lines of work whose clock the test turns.
class ProgressLinesTest : public ::testing::Test {
 protected:
  void update(const std::string& stage, std::size_t done, std::size_t total, double after_s = 1.0) {
    now_s_ += after_s;
    progress_.update(stage, done, total);
  }
  [[nodiscard]] std::vector<double> fractions() const {
    std::vector<double> all;
    for (const nlohmann::json& line : lines_) all.push_back(line.at("fraction"));
    return all;
  }

  double now_s_ = 100.0;
  std::vector<nlohmann::json> lines_;
  ProgressLines progress_{{{"read", 1.0}, {"work", 3.0}, {"write", 0.0}},
                          [this](std::string_view line) {
                            EXPECT_EQ(line.find('\n'), line.size() - 1);
                            lines_.push_back(nlohmann::json::parse(line));
                          },
                          [this] { return now_s_; }};
};

TEST_F(ProgressLinesTest, CountsTheFractionOverAllStages) {
  update("read", 1, 2);
  update("read", 2, 2);
  update("work", 1, 4);
  update("write", 1, 1);
  EXPECT_THAT(fractions(), ElementsAre(0.125, 0.25, 0.4375, 1.0));
  EXPECT_EQ(lines_[2].at("stage"), "work");
  EXPECT_EQ(lines_[2].at("done"), 1);
  EXPECT_EQ(lines_[2].at("total"), 4);
}

TEST_F(ProgressLinesTest, NeverFallsBack) {
  update("work", 3, 4);
  update("work", 0, 4);
  update("read", 1, 2);
  update("what no plan knows", 1, 2);
  EXPECT_THAT(fractions(), ElementsAre(0.8125, 0.8125, 0.8125, 0.8125));
}

TEST_F(ProgressLinesTest, EstimatesTheTimeFromWhatWasDoneAndNotFromWhatWasSkipped) {
  update("read", 0, 2);
  EXPECT_TRUE(lines_[0].at("eta_s").is_null());
  // Nothing was read: half of the work in 2 s, so the other half takes 2 s.
  update("work", 2, 4, 1.0);
  EXPECT_THAT(lines_[1].at("eta_s").get<double>(), DoubleNear(2.0, 1e-9));
}

TEST_F(ProgressLinesTest, WritesAtMostFourASecondAndEveryStage) {
  for (std::size_t i = 1; i <= 1000; ++i) update("read", i, 1000, 0.001);
  EXPECT_THAT(lines_, SizeIs(4));
  update("work", 0, 1, 0.0);
  update("write", 0, 1, 0.0);
  EXPECT_THAT(lines_, SizeIs(6));
}

TEST_F(ProgressLinesTest, SaysTheOutcomeLastHoweverSoon) {
  update("read", 1, 2);
  EXPECT_FALSE(lines_.back().contains("outcome"));
  progress_.finish("failed", "caf\xE9.bin: \"broken\"\n");
  EXPECT_EQ(lines_.back().at("outcome"), "failed");
  EXPECT_EQ(lines_.back().at("fraction"), 0.125);
  progress_.finish("succeeded", "");
  EXPECT_EQ(lines_.back().at("fraction"), 1.0);
}

TEST_F(ProgressLinesTest, KnowsNoDivisionByZero) {
  update("work", 0, 0);
  EXPECT_THAT(fractions(), ElementsAre(0.25));
  EXPECT_EQ(nlohmann::json::parse(cancelled_line()).at("outcome"), "cancelled");
}

}  // namespace progress_lines_test
}  // namespace stillmap::mapping
