#include "jobs/job_folder.hpp"

#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

#include <gmock/gmock.h>

#include <stillmap/maps/error.hpp>

#include <filesystem>

namespace stillmap::server {
namespace job_folder_test {

using test::ThrowsSaying;

TEST(JobFolder, ReplacesSmallFilesAsAWhole) {
  const test::TemporaryFolder folder;
  const std::filesystem::path file = folder.path() / "outcome.json";
  EXPECT_EQ(read_small_file(file), std::nullopt);
  write_small_file(file, "a longer text than the next");
  // What a killed server left.
  folder.write("outcome.json.new", "half of something that was never finished");
  write_small_file(file, "short");
  EXPECT_EQ(read_small_file(file), "short");
  write_small_file(file, "");
  EXPECT_EQ(read_small_file(file), "");
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "outcome.json.new"));
}

TEST(JobFolder, NamesTheFileAndTheReasonOfAFailure) {
  const test::TemporaryFolder folder;
  EXPECT_THAT([&] { write_small_file(folder.path() / "gone/crashes", "1"); },
              ThrowsSaying<maps::StorageError>({"gone/crashes", "No such file"}));
  std::filesystem::create_directories(folder.path() / "crashes/inside");
  EXPECT_THAT([&] { write_small_file(folder.path() / "crashes", "1"); },
              ThrowsSaying<maps::StorageError>({"crashes", "directory"}));
}

}  // namespace job_folder_test
}  // namespace stillmap::server
