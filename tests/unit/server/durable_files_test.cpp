#include "store/durable_files.hpp"

#include <stillmap/maps/error.hpp>

#include <fstream>
#include <iterator>
#include <string>

#include "support/disk_calls.hpp"
#include "support/temporary_folder.hpp"
#include "support/throws.hpp"

namespace stillmap::server {
namespace durable_files_test {

using ::stillmap::test::FailingCalls;
using ::stillmap::test::Fault;
using ::stillmap::test::RecordingCalls;
using ::stillmap::test::TemporaryFolder;
using ::stillmap::test::ThrowsSaying;
using Kind = DiskCall::Kind;

std::string text_of(const std::filesystem::path& file) {
  std::ifstream stream(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}

TEST(DurableFiles, PassesEveryChangeInOrder) {
  const TemporaryFolder folder;
  RecordingCalls calls;
  const DurableFiles files(calls);
  EXPECT_TRUE(files.make_folder(folder.path() / "a"));
  EXPECT_FALSE(files.make_folder(folder.path() / "a"));
  auto file = files.create(folder.path() / "a/b");
  file.append("12");
  file.append("345");
  file.finish();
  files.sync_folder(folder.path() / "a");
  files.rename(folder.path() / "a", folder.path() / "c");
  EXPECT_EQ(text_of(folder.path() / "c/b"), "12345");
  files.remove_tree(folder.path() / "c");
  EXPECT_FALSE(exists(folder.path() / "c"));
  std::vector<Kind> kinds;
  for (const auto& call : calls.calls()) kinds.push_back(call.kind);
  EXPECT_THAT(kinds, ::testing::ElementsAre(Kind::kMakeFolder, Kind::kCreateFile, Kind::kWrite,
                                            Kind::kWrite, Kind::kSyncFile, Kind::kSyncFolder,
                                            Kind::kRename, Kind::kRemoveFile, Kind::kRemoveFolder));
  EXPECT_EQ(calls.calls()[3].offset, 2U);
  EXPECT_EQ(calls.calls()[3].bytes, "345");
}

TEST(DurableFiles, GoesOnAfterAShortWrite) {
  const TemporaryFolder folder;
  FailingCalls calls(Fault::kShortWrite, [](std::size_t n, const auto&) { return n == 1; });
  auto file = DurableFiles(calls).create(folder.path() / "a");
  file.append("0123456789");
  file.finish();
  EXPECT_EQ(calls.failed(), 1U);
  EXPECT_EQ(text_of(folder.path() / "a"), "0123456789");
}

TEST(DurableFiles, NamesThePathOfEveryFailure) {
  const TemporaryFolder folder;
  FailingCalls calls(Fault::kNoSpace, [](std::size_t, const auto&) { return true; });
  const DurableFiles files(calls);
  const std::filesystem::path at = folder.path() / "victim";
  EXPECT_THAT([&] { files.make_folder(at); },
              ThrowsSaying<maps::StorageError>({"victim", "No space"}));
  EXPECT_THAT([&] { (void)files.create(at); },
              ThrowsSaying<maps::StorageError>({"victim", "No space"}));
  EXPECT_THAT([&] { files.sync_folder(at); },
              ThrowsSaying<maps::StorageError>({"victim", "No space"}));
  EXPECT_THAT([&] { files.rename(at, at); },
              ThrowsSaying<maps::StorageError>({"victim", "No space"}));
  EXPECT_THAT([&] { files.exchange(at, at); },
              ThrowsSaying<maps::StorageError>({"victim", "No space"}));
  FailingCalls failing_sync(Fault::kInputOutput, [](std::size_t, const DiskCall& call) {
    return call.kind == Kind::kSyncFile;
  });
  auto file = DurableFiles(failing_sync).create(at);
  EXPECT_THAT([&] { file.finish(); }, ThrowsSaying<maps::StorageError>({"victim", "Input/output"}));
}

TEST(DurableFiles, WritesNoFileThatIsThereAndFollowsNoLink) {
  const TemporaryFolder folder;
  const DurableFiles files(DiskCalls::real());
  folder.write("a", "kept");
  folder.write("outside/kept", "kept");
  std::filesystem::create_symlink(folder.path() / "a", folder.path() / "link");
  EXPECT_THAT([&] { (void)files.create(folder.path() / "a"); },
              ThrowsSaying<maps::StorageError>({"exists"}));
  EXPECT_THAT([&] { (void)files.create(folder.path() / "link"); },
              ThrowsSaying<maps::StorageError>({"link"}));
  files.make_folder(folder.path() / "tree");
  std::filesystem::create_symlink(folder.path() / "outside", folder.path() / "tree/out");
  files.remove_tree(folder.path() / "tree");
  EXPECT_EQ(text_of(folder.path() / "outside/kept"), "kept");
}

}  // namespace durable_files_test
}  // namespace stillmap::server
