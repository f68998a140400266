#include "operation/startup_check.hpp"

#include <gmock/gmock.h>

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "support/temporary_folder.hpp"

namespace stillmap::server {
namespace startup_check_test {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

class StartupCheck : public ::testing::Test {
 protected:
  std::vector<std::string> found() const {
    std::vector<std::string> texts;
    for (const ConfigProblem& each : problems_of_files(config_)) texts.push_back(each.text());
    return texts;
  }
  std::string path(const char* name) const { return (folder_.path() / name).string(); }
  /// How many files and folders there are.
  std::ptrdiff_t entries() const {
    const std::filesystem::recursive_directory_iterator each(folder_.path());
    return std::distance(begin(each), end(each));
  }

  test::TemporaryFolder folder_;
  ResolvedConfig config_;
};

TEST_F(StartupCheck, WhatIsNotNamedIsNotLookedAt) { EXPECT_THAT(found(), IsEmpty()); }

TEST_F(StartupCheck, NothingIsMadeOfWhatCanBeUsed) {
  std::filesystem::create_directory(path("store"));
  config_.options.store = path("store");
  config_.options.log.file = path("server.log");
  EXPECT_THAT(found(), IsEmpty());
  EXPECT_EQ(entries(), 1);
  folder_.write("server.log", "earlier\n");
  EXPECT_THAT(found(), IsEmpty());
  EXPECT_EQ(std::filesystem::file_size(path("server.log")), 8U);
}

TEST_F(StartupCheck, AStoreThatIsMissingCanBeMade) {
  for (const char* name : {"none", "none/"}) {
    config_.options.store = path(name);
    EXPECT_THAT(found(), IsEmpty()) << name;
  }
  EXPECT_EQ(entries(), 0);
}

TEST_F(StartupCheck, EveryProblemIsNamedWithItsOrigin) {
  config_.origins = {{"store", "f.json"}, {"log.file", "--log-file"}};
  config_.options.store = path("none/store");
  config_.options.tls = {.certificate_file = path("c.pem"), .key_file = path("k.pem")};
  config_.options.log.file = path("logs/server.log");
  EXPECT_THAT(
      found(),
      ElementsAre(AllOf(StartsWith("f.json: store: found "), HasSubstr("none (No such file")),
                  AllOf(StartsWith("default: tls.certificate_file: found "), HasSubstr("c.pem")),
                  AllOf(StartsWith("--log-file: log.file: found "), HasSubstr("logs (No such file"),
                        HasSubstr("expected a folder that the log file can be made in"))));
  EXPECT_EQ(entries(), 0);
}

TEST_F(StartupCheck, FilesAreNoFoldersAndFoldersNoFiles) {
  config_.options.store = folder_.write("file", "").string();
  config_.options.log.file = folder_.path().string();
  EXPECT_THAT(found(), ElementsAre(HasSubstr("(no folder)"), HasSubstr("(a folder)")));
}

/// Nobody in particular, who may read only what all may, where root runs the tests.
class AsNobody {
 public:
  AsNobody() : is_(::getuid() != 0 || ::setresuid(65534, 65534, 0) == 0) {}
  ~AsNobody() {
    if (was_root_ && ::setresuid(0, 0, 0) != 0) std::abort();
  }
  AsNobody(const AsNobody&) = delete;
  AsNobody& operator=(const AsNobody&) = delete;
  [[nodiscard]] bool is() const { return is_; }

 private:
  bool was_root_ = ::getuid() == 0;
  bool is_;
};

TEST_F(StartupCheck, AStoreThatMayNotBeReadIsOneProblemAmongOthers) {
  namespace fs = std::filesystem;
  fs::permissions(folder_.path(), fs::perms::all);
  fs::create_directory(path("store"));
  fs::permissions(path("store"), fs::perms::none);
  config_.options.store = path("store");
  config_.options.log.file = path("logs/server.log");
  {
    const AsNobody nobody;
    if (!nobody.is()) GTEST_SKIP() << "root may not become another user here";
    EXPECT_THAT(found(), ElementsAre(AllOf(HasSubstr("store (Permission denied)"),
                                           HasSubstr("expected a folder that can be read")),
                                     HasSubstr("logs (No such file")));
    config_.options.store = path("store/within");
    EXPECT_THAT(found(), ElementsAre(HasSubstr("within (Permission denied)"),
                                     HasSubstr("logs (No such file")));
  }
  fs::permissions(path("store"), fs::perms::owner_all);
}

}  // namespace startup_check_test
}  // namespace stillmap::server
