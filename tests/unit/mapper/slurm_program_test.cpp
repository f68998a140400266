#include "mapper/slurm_program.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fmt/format.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <thread>

namespace stillmap::mapper {
namespace slurm_program_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

bool never() { return false; }

TEST(SlurmProgram, SaysWhatItWrites) {
  const ProgramOutput output =
      run_slurm_program({"sh", "-c", "echo out; echo err >&2; exit 3"}, never);
  EXPECT_FALSE(output.was_left);
  EXPECT_EQ(output.exit_code, 3);
  EXPECT_EQ(output.out, "out\n");
  EXPECT_EQ(output.err, "err\n");
}

TEST(SlurmProgram, DoesNotGetTheHabitsOfTheUser) {
  for (const char* name : {"SQUEUE_STATES", "SCANCEL_STATE", "SLURM_CLUSTERS", "SBATCH_WAIT",
                           "SBATCH_WAIT_ALL_NODES", "SLURM_CONF"})
    ::setenv(name, "hers", 1);
  const ProgramOutput output = run_slurm_program({"env"}, never);
  EXPECT_THAT(output.out, AllOf(Not(HasSubstr("SQUEUE_")), Not(HasSubstr("SCANCEL_")),
                                Not(HasSubstr("SLURM_CLUSTERS")), Not(HasSubstr("SBATCH_WAIT="))));
  EXPECT_THAT(output.out, AllOf(HasSubstr("SBATCH_WAIT_ALL_NODES=hers"),
                                HasSubstr("SLURM_CONF=hers"), HasSubstr("PATH=")));
}

TEST(SlurmProgram, IsKilledWhenNobodyWaitsForIt) {
  EXPECT_TRUE(run_slurm_program({"sleep", "1000"}, [] { return true; }).was_left);
  EXPECT_EQ(::waitpid(-1, nullptr, WNOHANG), -1) << "a child is left";
}

TEST(SlurmProgram, GoesOnWhenItWritesAfterNobodyWaitsForIt) {
  const std::filesystem::path file =
      std::filesystem::path(::testing::TempDir()) / fmt::format("slurm_program.{}", ::getpid());
  const ProgramOutput output = run_slurm_program(
      {"sh", "-c", "sleep 0.3; echo out; echo err >&2; : >\"$0\"", file.string()},
      [] { return true; }, Unawaited::kGoesOn);
  EXPECT_TRUE(output.was_left);
  for (int i = 0; i < 100 && !std::filesystem::exists(file); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  EXPECT_TRUE(std::filesystem::remove(file));
}

}  // namespace slurm_program_test
}  // namespace stillmap::mapper
