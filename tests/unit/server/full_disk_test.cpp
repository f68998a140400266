#include <gmock/gmock.h>

#include <atomic>
#include <filesystem>
#include <string>

#include "job_fixture.hpp"
#include "support/disk_calls.hpp"
#include "support/store_contents.hpp"

namespace stillmap::server {
namespace full_disk_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

TEST(FullDisk, UploadIsAnswered507AndLeavesNothing) {
  const test::TemporaryFolder built(test::memory_folder()), folder(test::memory_folder());
  test::write_package(built.path() / "new", 7);
  const std::string tar = test::tar_of(built.path() / "new", "") + test::tar_end();
  std::atomic<bool> full = false;
  test::FailingCalls calls(test::Fault::kNoSpace, [&](std::size_t, const DiskCall& call) {
    return full && call.kind == DiskCall::Kind::kWrite;
  });
  PackageStore store(folder.path(), calls);
  const Service service(
      {}, store,
      [](const maps::MapPackage&, const localization::LocalizationOptions&) { return Aligners{}; },
      {});
  const auto put = [&] {
    HttpRequest request;
    request.method = "PUT";
    request.path = "/v1/maps/town/versions/v1";
    BodyInMemory body(tar);
    request.stream = &body;
    return service.handle(std::move(request));
  };
  full = true;
  const HttpResponse refused = put();
  EXPECT_EQ(refused.status, 507);
  EXPECT_THAT(refused.body, HasSubstr("DiskFull"));
  EXPECT_THAT(refused.body, Not(HasSubstr(folder.path().string())));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path() / "packages"));
  full = false;
  EXPECT_EQ(put().status, 201);
}

TEST(FullDisk, KeysAreRevokedAndDrivesRemovedAndBothAreInTheAuditLog) {
  const test::TemporaryFolder folder(test::memory_folder());
  test::FullDisk disk;
  PackageStore store(folder.path(), disk);
  store.create_map("town");
  const auto drive = std::to_string(store.drives().open("town", "monday", 1).id);
  const KeyTable::Created thief = store.keys().create("thief", {.bits = 1}, {}, unix_ns());
  const KeyTable::Created admin = store.keys().create("admin", {.bits = 15}, {}, unix_ns());
  const Service service(
      {}, store,
      [](const maps::MapPackage&, const localization::LocalizationOptions&) { return Aligners{}; },
      {});
  const auto send = [&](const std::string& method, const std::string& path) {
    HttpRequest request;
    request.method = method;
    request.path = path;
    request.headers["authorization"] = "Bearer " + admin.text;
    return service.handle(std::move(request));
  };
  for (const std::string& path : {"/v1/keys/" + thief.key.id, "/v1/maps/town/drives/" + drive}) {
    store.state().keep_ballast();
    disk.fill();
    const HttpResponse done = send("DELETE", path);
    EXPECT_LT(done.status, 300) << done.body;
    EXPECT_FALSE(disk.is_full());
  }
  EXPECT_EQ(store.keys().check(thief.text, unix_ns()).verdict, KeyCheck::Verdict::kRevoked);
  EXPECT_EQ(store.audit().list(9).records.size(), 2U);
}

class DiskReserve : public JobTest {
 protected:
  void expect_refused(const HttpResponse& response) {
    EXPECT_EQ(response.status, 507) << response.body;
    EXPECT_EQ(body(response)["code"], "DiskFull");
    EXPECT_THAT(body(response)["detail"].get<std::string>(),
                AllOf(HasSubstr("bytes free"), HasSubstr(std::to_string(kAll)),
                      HasSubstr("remove versions or drives")));
  }
  /// More than any disk has.
  static constexpr std::int64_t kAll = std::int64_t{1} << 50U;
};

TEST_F(DiskReserve, RefusesWhatBringsBytesAndNothingElse) {
  options_.quotas.disk_reserve_bytes = 0;
  start_with("publish");
  const std::string drive = "/v1/maps/town/drives/" + std::to_string(make_drive());
  const std::string open =
      "/v1/maps/town/drives/" +
      std::to_string(body(send("POST", "/v1/maps/town/drives"))["id"].get<int>());
  const std::string part = test::tar_file("a/0.bin", std::string(64, '\x3f')) + test::tar_end();
  EXPECT_EQ(put(open + "/parts/1", part).status, 201);
  options_.quotas.disk_reserve_bytes = kAll;
  service_->reload(options_);
  const std::string tar = test::tar_of(scripts_.path() / "package", "") + test::tar_end();
  expect_refused(put("/v1/maps/town/versions/v2", tar, "application/x-tar"));
  expect_refused(put("/v1/maps/town/versions/v3", kPly, "application/ply"));
  expect_refused(put(open + "/parts/2", "abc"));
  expect_refused(send("POST", open + "/complete"));
  expect_refused(send("PUT", "/v1/maps/town/edits",
                      R"({"format": "stillmap-edits", "version": 1, "edits": []})"));
  expect_refused(send("POST", "/v1/maps/town/rebuild", R"({"drives": [1]})"));
  EXPECT_EQ(service_->handle(good_request()).status, 200);
  EXPECT_EQ(send("DELETE", drive).status, 204);
  options_.quotas.disk_reserve_bytes = 0;
  service_->reload(options_);
  EXPECT_EQ(send("POST", open + "/complete").status, 200) << "its part is there still";
  EXPECT_EQ(put("/v1/maps/town/versions/v2", tar, "application/x-tar").status, 201);
}

/// A body of which the disk is short when it has half come.
TEST_F(DiskReserve, EndsAnUploadThatReachesIntoItAndLeavesNothing) {
  start();
  class ShortOfDisk final : public BodyStream {
   public:
    ShortOfDisk(std::string bytes, std::function<void()> halfway)
        : bytes_(std::move(bytes)), halfway_(std::move(halfway)) {}
    [[nodiscard]] std::uint64_t size() const override { return bytes_.size(); }
    std::size_t read(std::span<char> to) override {
      const std::size_t count = bytes_.copy(to.data(), std::min<std::size_t>(to.size(), 512), at_);
      at_ += count;
      halfway_();
      return count;
    }

   private:
    std::string bytes_;
    std::function<void()> halfway_;
    std::size_t at_ = 0;
  };
  options_.quotas.disk_reserve_bytes = kAll;
  ShortOfDisk stream(test::tar_of(scripts_.path() / "package", "") + test::tar_end(),
                     [&] { service_->reload(options_); });
  HttpRequest asked = request("PUT", "/v1/maps/town/versions/v2");
  asked.headers["content-type"] = "application/x-tar";
  asked.stream = &stream;
  expect_refused(service_->handle(asked));
  const std::filesystem::path packages = store_.folder().path() / "packages";
  EXPECT_EQ(std::distance(std::filesystem::directory_iterator(packages), {}), 1);
}

}  // namespace full_disk_test
}  // namespace stillmap::server
