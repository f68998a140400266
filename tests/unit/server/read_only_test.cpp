#include <gmock/gmock.h>

#include "service_fixture.hpp"

namespace stillmap::server {
namespace read_only_test {

using ::testing::HasSubstr;

/// A service that serves one map from its folder.
class ReadOnlyTest : public ServiceTest {
 protected:
  void SetUp() override {
    service_ = std::make_unique<Service>(
        options_, store_.open(),
        [this](const maps::MapPackage&, const localization::LocalizationOptions&) {
          return Aligners{{"default", aligner_}};
        },
        std::vector<WebAsset>{}, mapper_, StoreChanges::kRefused);
    wait_until_loaded();
  }
};

TEST_F(ReadOnlyTest, AnswersPosesAndWhatIsRead) {
  EXPECT_EQ(service_->handle(good_request()).status, 200);
  for (const char* path : {"/v1/maps", "/v1/maps/town", "/v1/maps/town/versions", "/v1/keys",
                           "/v1/jobs", "/v1/status", "/readyz"})
    EXPECT_EQ(get(path).status, 200) << path;
}

TEST_F(ReadOnlyTest, RefusesEveryChangeAndSaysWhatToDo) {
  const std::vector<std::pair<const char*, const char*>> changes = {
      {"PUT", "/v1/maps/new"},
      {"DELETE", "/v1/maps/town"},
      {"PUT", "/v1/maps/town/versions/v9"},
      {"POST", "/v1/maps/town/versions/v1/activate"},
      {"POST", "/v1/maps/town/rollback"},
      {"POST", "/v1/maps/town/drives"},
      {"POST", "/v1/maps/town/rebuild"},
      {"PUT", "/v1/maps/town/edits"},
      {"POST", "/v1/keys"}};
  for (const auto& [method, path] : changes) {
    const HttpResponse response = service_->handle(request(method, path));
    EXPECT_EQ(response.status, 403) << method << " " << path;
    EXPECT_EQ(body(response)["code"], "ReadOnly") << method << " " << path;
    EXPECT_THAT(std::string(body(response)["detail"]), HasSubstr("stillmap serve --store"));
  }
}

TEST_F(ReadOnlyTest, KeepsNoRouteThatChangesTheStore) {
  std::size_t refused = 0;
  for (const Route* route : service_->routes()) {
    const bool changes = route->access == Access::kWrite || route->access == Access::kAdmin;
    if (!changes || route->method == "GET") continue;
    std::string path;
    bool in_name = false;
    for (const char c : route->pattern) {
      if (c == '{') path += '1';
      in_name = c == '{' || (in_name && c != '}');
      if (!in_name && c != '}') path += c;
    }
    EXPECT_EQ(body(service_->handle(request(route->method, path)))["code"], "ReadOnly")
        << route->method << " " << path;
    ++refused;
  }
  EXPECT_GE(refused, 15U);
}

}  // namespace read_only_test
}  // namespace stillmap::server
