#include "mapper/slurm_program.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

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

}  // namespace slurm_program_test
}  // namespace stillmap::mapper
