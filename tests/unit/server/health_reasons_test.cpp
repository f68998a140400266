#include <gmock/gmock.h>

#include <atomic>
#include <string>

#include "service_fixture.hpp"
#include "support/disk_calls.hpp"

namespace stillmap::server {
namespace health_reasons_test {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

HttpResponse ask(const Service& service, const std::string& method, const std::string& path) {
  HttpRequest request;
  request.method = method;
  request.path = path;
  return service.handle(std::move(request));
}

/// @return the reasons beside 200.
std::vector<std::string> reasons(const Service& service) {
  const HttpResponse response = ask(service, "GET", "/readyz");
  EXPECT_EQ(response.status, 200) << "poses are answered, so it stays ready";
  return nlohmann::json::parse(response.body)["reasons"];
}

TEST(HealthReasons, SayThatTheStoreTakesNoChangesAfterAFailedSync) {
  const test::TemporaryFolder folder(test::memory_folder());
  std::atomic<bool> broken = false;
  test::FailingCalls disk(test::Fault::kInputOutput, [&](std::size_t, const DiskCall& call) {
    return broken && call.kind == DiskCall::Kind::kSyncFile;
  });
  PackageStore store(folder.path(), disk);
  Service service(
      {}, store,
      [](const maps::MapPackage&, const localization::LocalizationOptions&) { return Aligners{}; },
      {});
  EXPECT_EQ(ask(service, "PUT", "/v1/maps/town").status, 201);
  EXPECT_THAT(reasons(service), IsEmpty());
  EXPECT_THAT(service.metrics().text(), HasSubstr("stillmap_store_writable 1"));
  broken = true;
  EXPECT_EQ(ask(service, "PUT", "/v1/maps/yard").status, 500);
  broken = false;
  EXPECT_EQ(ask(service, "PUT", "/v1/maps/lane").status, 500) << "its disk is not trusted again";
  EXPECT_THAT(reasons(service),
              ElementsAre(AllOf(HasSubstr("takes no changes"), HasSubstr("start the server again"),
                                Not(HasSubstr(folder.path().string())))));
  EXPECT_THAT(service.metrics().text(), HasSubstr("stillmap_store_writable 0"));
}

TEST(HealthReasons, SayThatTheStoreTakesNoChangesUntilItsDiskTakesThemAgain) {
  const test::TemporaryFolder folder(test::memory_folder());
  std::atomic<bool> broken = false;
  test::FailingCalls disk(test::Fault::kInputOutput, [&](std::size_t, const DiskCall& call) {
    return broken && call.kind == DiskCall::Kind::kWrite;
  });
  PackageStore store(folder.path(), disk);
  Service service(
      {}, store,
      [](const maps::MapPackage&, const localization::LocalizationOptions&) { return Aligners{}; },
      {});
  broken = true;
  EXPECT_EQ(ask(service, "PUT", "/v1/maps/town").status, 500);
  EXPECT_THAT(reasons(service),
              ElementsAre(HasSubstr("refused the latest one: Input/output error")));
  EXPECT_THAT(service.metrics().text(), HasSubstr("stillmap_store_writable 0"));
  broken = false;
  EXPECT_EQ(ask(service, "PUT", "/v1/maps/town").status, 201);
  EXPECT_THAT(reasons(service), IsEmpty());
  EXPECT_THAT(service.metrics().text(), HasSubstr("stillmap_store_writable 1"));
}

class DiskBelowItsReserve : public ServiceTest {};

TEST_F(DiskBelowItsReserve, IsAReasonAndAMetric) {
  start();
  EXPECT_THAT(reasons(*service_), IsEmpty());
  options_.quotas.disk_reserve_bytes = std::int64_t{1} << 50U;
  service_->reload(options_);
  EXPECT_THAT(reasons(*service_),
              ElementsAre(AllOf(HasSubstr("less than its reserve of 1125899907 MB"),
                                HasSubstr("remove versions or drives"))));
  EXPECT_THAT(service_->metrics().text(),
              HasSubstr("stillmap_store_reserve_bytes 1125899906842624"));
}

}  // namespace health_reasons_test
}  // namespace stillmap::server
