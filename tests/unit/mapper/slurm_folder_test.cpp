#include "mapper/slurm_folder.hpp"

#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <memory>
#include <thread>

namespace stillmap::mapper {
namespace slurm_folder_test {

namespace fs = std::filesystem;

class SlurmFolder : public ::testing::Test {
 protected:
  void write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
  }
  [[nodiscard]] std::string removed() const { return folder_.string() + "-done"; }
  void TearDown() override {
    fs::remove_all(folder_);
    fs::remove_all(removed());
  }

  fs::path folder_ =
      fs::path(::testing::TempDir()) / ("slurm_folder." + std::to_string(::getpid()));
  mapping::CancelFlag cancel_{false};
};

TEST_F(SlurmFolder, StaysUntilItIsDone) {
  { const HeldFolder held(folder_, cancel_); }
  EXPECT_TRUE(fs::exists(folder_));
  HeldFolder(folder_, cancel_).set_done();
  EXPECT_FALSE(fs::exists(folder_));
  EXPECT_FALSE(fs::exists(removed()));
}

TEST_F(SlurmFolder, IsHeldAnewWhenTheProcessBeforeHasRemovedIt) {
  auto first = std::make_unique<HeldFolder>(folder_, cancel_);
  write("plan", "this plan");
  std::unique_ptr<HeldFolder> second;
  std::thread waiting([&] { second = std::make_unique<HeldFolder>(folder_, cancel_); });
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  first->set_done();
  first.reset();
  waiting.join();
  EXPECT_EQ(second->plan_of_other(), "this plan");
  EXPECT_FALSE(fs::exists(folder_ / "plan"));
  // Of a third process it is the same file that is locked.
  cancel_ = true;
  EXPECT_THROW(HeldFolder(folder_, cancel_), mapping::Cancelled);
}

TEST_F(SlurmFolder, SaysTheLastLineOfAFile) {
  fs::create_directories(folder_);
  EXPECT_EQ(last_line_in(folder_ / "log"), "");
  write("log", std::string(10'000, 'x') + "\nlast\n\n");
  EXPECT_EQ(last_line_in(folder_ / "log"), "last");
  write("failed", "137\n");
  EXPECT_EQ(number_in(folder_ / "failed"), 137);
  EXPECT_EQ(number_in(folder_ / "log"), std::nullopt);
}

}  // namespace slurm_folder_test
}  // namespace stillmap::mapper
