#include <gmock/gmock.h>

#include <stillmap/server/server_options.hpp>

#include <stdexcept>

#include "errors/error_codes.hpp"
#include "service_fixture.hpp"

namespace stillmap::server {
namespace server_options_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(ServerOptions, DefaultsAreUsable) { EXPECT_THAT(ServerOptions{}.violations(), IsEmpty()); }

TEST(ServerOptions, EveryBrokenBoundIsNamedAtOnce) {
  ServerOptions options;
  options.port = 65536;
  options.connections = 0;
  options.min_scan_points = options.max_scan_points + 1;
  EXPECT_THAT(options.violations(),
              ElementsAre(HasSubstr("port: 65536"), HasSubstr("connections: 0"),
                          HasSubstr("max_scan_points"), HasSubstr("event_streams")));
}

TEST(ServerOptions, ProxiesAreNamedWhereTheyAreBelieved) {
  ServerOptions options;
  options.trusted_proxies = "10.0.0.0/8, ::1";
  EXPECT_THAT(options.violations(), IsEmpty());
  for (const char* forwarded : {"x-forwarded-for", "proxy"}) {
    options.forwarded = forwarded;
    options.trusted_proxies = "10.0.0.0/8, ::1";
    EXPECT_THAT(options.violations(), IsEmpty());
    options.trusted_proxies = "";
    EXPECT_THAT(options.violations(), ElementsAre(HasSubstr("forwarded: ")));
  }
  options.forwarded = "none";
  options.trusted_proxies = "proxy.example.org";
  EXPECT_THAT(options.violations(), ElementsAre(HasSubstr("trusted_proxies: ")));
}

TEST(ServerOptions, AddressesThatOthersReachNeedLeave) {
  ServerOptions options;
  for (const char* host : {"0.0.0.0", "192.168.1.2", "::", "127.example.org", ""}) {
    options.host = host;
    EXPECT_THAT(options.violations(), ElementsAre(HasSubstr("host"))) << host;
  }
  for (const char* host : {"127.0.0.1", "127.3.2.1", "localhost", "::1"}) {
    options.host = host;
    EXPECT_THAT(options.violations(), IsEmpty()) << host;
  }
  options.host = "0.0.0.0";
  options.allow_remote = true;
  EXPECT_THAT(options.violations(), IsEmpty());
}

TEST(ServerOptions, ServiceRefusesBrokenOnes) {
  const TownStore store;
  const ServerOptions options{.queue = -1};
  const auto build = [](const maps::MapPackage&, const localization::LocalizationOptions&) {
    return Aligners{};
  };
  EXPECT_THROW(Service(options, store.open(), build, {}), std::invalid_argument);
}

TEST(ErrorCodes, TextsAreUniqueAndStatusesAreErrors) {
  std::set<std::string_view> texts;
  for (const ErrorInfo& error : all_errors()) {
    EXPECT_TRUE(texts.insert(error.text).second) << error.text;
    EXPECT_GE(error.http_status, 400) << error.text;
    EXPECT_LT(error.http_status, 600) << error.text;
    EXPECT_FALSE(error.title.empty());
    EXPECT_EQ(&info_of(error.code), &error);
  }
}

}  // namespace server_options_test
}  // namespace stillmap::server
