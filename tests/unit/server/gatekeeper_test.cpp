#include "security/gatekeeper.hpp"

#include <gmock/gmock.h>

#include <chrono>
#include <set>

#include "management.hpp"
#include "service_fixture.hpp"

namespace stillmap::server {
namespace gatekeeper_test {

using std::chrono::milliseconds;
using ::testing::Contains;
using ::testing::IsSubsetOf;
using ::testing::Pair;
using ::testing::StartsWith;

std::int64_t now_ns() {
  return std::chrono::duration_cast<std::chrono::nanoseconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

KeyScopes only(KeyScope scope) {
  KeyScopes scopes;
  scopes.add(scope);
  return scopes;
}

/// A service that is asked with and without keys.
class GatekeeperTest : public ServiceTest {
 protected:
  std::string make_key(KeyScopes scopes, std::optional<std::int64_t> expires_ns = {}) {
    return store_.open().keys().create("test", scopes, expires_ns, now_ns()).text;
  }
  /// A request that fits the route, as far as its path goes.
  static HttpRequest request_to(const Route& route) {
    std::string path;
    bool in_name = false;
    for (const char c : route.pattern) {
      if (c == '{') path += '1';
      in_name = c == '{' || (in_name && c != '}');
      if (!in_name && c != '}') path += c;
    }
    return request(route.method, path);
  }
  /// What the head of a request is answered with; nothing when its body may come.
  [[nodiscard]] std::optional<ErrorCode> refusal(HttpRequest request,
                                                 const std::string& authorization) const {
    if (!authorization.empty()) request.headers["authorization"] = authorization;
    try {
      (void)service_->admit(request);
      return std::nullopt;
    } catch (const ApiError& error) {
      return error.code();
    }
  }
  [[nodiscard]] std::optional<ErrorCode> refusal(const std::string& authorization) const {
    return refusal(request("GET", "/v1/maps"), authorization);
  }
};

TEST_F(GatekeeperTest, OnlyHealthAndThePageAreOpen) {
  start();
  std::set<std::string> open;
  for (const Route* route : service_->routes())
    if (is_open(route->access)) open.insert(route->method + " " + route->pattern);
  EXPECT_THAT(open, IsSubsetOf(std::set<std::string>{"GET /livez", "GET /healthz", "GET /readyz",
                                                     "GET /", "GET /openapi.json"}));
}

TEST_F(GatekeeperTest, NoRouteThatChangesTheStoreIsForReaders) {
  start();
  for (const Route* route : service_->routes()) {
    // Tells what has changed, and changes nothing; its question is too long for a query.
    const bool asks = route->method == "GET" || route->pattern == "/v1/maps/{map}/tiles/diff";
    if (asks) continue;
    EXPECT_FALSE(is_open(route->access)) << route->pattern;
    EXPECT_NE(route->access, Access::kRead) << route->pattern;
  }
}

TEST_F(GatekeeperTest, EveryRouteButTheOpenOnesNeedsAKeyOnceThereIsOne) {
  start();
  EXPECT_EQ(refusal(""), std::nullopt);
  make_key(only(KeyScope::kRead));
  for (const Route* route : service_->routes()) {
    const auto refused = refusal(request_to(*route), "");
    if (is_open(route->access))
      EXPECT_NE(refused, ErrorCode::kMissingKey) << route->pattern;
    else
      EXPECT_EQ(refused, ErrorCode::kMissingKey) << route->method << " " << route->pattern;
  }
  const HttpResponse response = get("/v1/maps");
  EXPECT_EQ(response.status, 401);
  EXPECT_THAT(response.headers, Contains(Pair("WWW-Authenticate", StartsWith("Bearer"))));
}

TEST_F(GatekeeperTest, KeyOpensTheRoutesOfItsScopeAndNoOthers) {
  start();
  const std::map<Access, KeyScope> scopes = {{Access::kRead, KeyScope::kRead},
                                             {Access::kLocalize, KeyScope::kLocalize},
                                             {Access::kWrite, KeyScope::kWrite},
                                             {Access::kAdmin, KeyScope::kAdmin}};
  for (const auto& [access, scope] : scopes) {
    const std::string key = "Bearer " + make_key(only(scope));
    for (const Route* route : service_->routes()) {
      const auto refused = refusal(request_to(*route), key);
      const bool either = (route->access == Access::kLocalizeOrAdmin &&
                           (scope == KeyScope::kLocalize || scope == KeyScope::kAdmin)) ||
                          (route->access == Access::kReadOrLocalize &&
                           (scope == KeyScope::kLocalize || scope == KeyScope::kRead));
      const bool fits = route->access == access || is_open(route->access) || either;
      EXPECT_EQ(refused == ErrorCode::kForbidden, !fits)
          << name_of(scope) << ": " << route->method << " " << route->pattern;
      EXPECT_NE(refused, ErrorCode::kRefusedKey);
    }
  }
}

TEST_F(GatekeeperTest, ReadinessTellsNamesOnlyToWhoeverMayReadThem) {
  start([](const maps::MapPackage&, const localization::LocalizationOptions&) -> Aligners {
    throw std::runtime_error("too few voxels");
  });
  wait_until_loaded();
  const auto asked = [&](const std::string& key, const std::string& host = "localhost") {
    HttpRequest ready = request("GET", "/readyz");
    ready.headers["host"] = host;
    if (!key.empty()) ready.headers["authorization"] = "Bearer " + key;
    const HttpResponse response = service_->handle(ready);
    EXPECT_EQ(response.status, 200);
    return body(response)["reasons"].dump();
  };
  const std::string names = R"(["map town version v1: too few voxels"])";
  const std::string counts = R"(["1 map: cannot be used"])";
  EXPECT_EQ(asked(""), names) << "without keys whoever reaches it may read";
  EXPECT_EQ(asked("", "evil.example"), counts) << "a name that somebody points to this machine";
  KeyTable& keys = store_.open().keys();
  const auto reader = keys.create("a", only(KeyScope::kRead), {}, now_ns());
  EXPECT_EQ(asked(""), counts);
  EXPECT_EQ(asked(reader.text), names);
  EXPECT_EQ(asked(make_key(only(KeyScope::kLocalize))), counts);
  EXPECT_EQ(asked(keys.create("b", only(KeyScope::kRead), {}, now_ns(), {"to*"}).text), names);
  EXPECT_EQ(asked(keys.create("c", only(KeyScope::kRead), {}, now_ns(), {"other"}).text), counts);
  keys.revoke(reader.key.id, now_ns());
  EXPECT_EQ(asked(reader.text), counts) << "a probe goes on when its key has ended";
  const Management management(*service_);
  HttpRequest watcher = request("GET", "/readyz");
  const Router::Match match = management.find(watcher);
  management.admit(watcher, match);
  EXPECT_EQ(body(management.handle(watcher, match))["reasons"].dump(), names);
}

TEST_F(GatekeeperTest, WhetherAMapIsReadyIsToldWithAKey) {
  start();
  const auto asked = [&](const std::string& map, const std::string& key) {
    HttpRequest ready = request("GET", "/v1/maps/" + map + "/ready");
    if (!key.empty()) ready.headers["authorization"] = "Bearer " + key;
    return service_->handle(ready).status;
  };
  EXPECT_EQ(asked("town", ""), 200);
  for (const KeyScope scope : {KeyScope::kRead, KeyScope::kLocalize}) {
    const std::string key = make_key(only(scope));
    EXPECT_EQ(asked("town", key), 200);
    EXPECT_EQ(asked("nowhere", key), 404);
  }
  EXPECT_EQ(asked("town", ""), 401);
  EXPECT_EQ(asked("nowhere", ""), 401);
  EXPECT_EQ(asked("town", make_key(only(KeyScope::kWrite))), 403);
}

TEST_F(GatekeeperTest, KeyIsRefusedOnceItHasExpiredOrWasRevoked) {
  start();
  KeyTable& keys = store_.open().keys();
  const auto lasting = keys.create("lasting", only(KeyScope::kRead), {}, now_ns());
  const std::string brief = make_key(only(KeyScope::kRead), now_ns() + std::int64_t{50'000'000});
  EXPECT_EQ(refusal("Bearer " + lasting.text), std::nullopt);
  std::this_thread::sleep_for(milliseconds(60));
  EXPECT_EQ(refusal("Bearer " + brief), ErrorCode::kRefusedKey);
  keys.revoke(lasting.key.id, now_ns());
  EXPECT_EQ(refusal("Bearer " + lasting.text), ErrorCode::kRefusedKey);
  // A store whose last key was revoked does not stand open.
  EXPECT_EQ(refusal(""), ErrorCode::kMissingKey);
}

TEST_F(GatekeeperTest, AnythingButAWholeKeyIsRefused) {
  start();
  const std::string key = make_key(only(KeyScope::kRead));
  std::string other_secret = key;
  other_secret.back() = other_secret.back() == '0' ? '1' : '0';
  for (const std::string& text :
       {std::string("Bearer"), std::string("Bearer "), "Bearer " + other_secret,
        "Bearer " + key.substr(0, key.size() - 1), "Bearer " + key + "0", "Basic " + key, key,
        "Bearer x " + key, "Bearer " + std::string(3000, 'x'), "Bearer " + key + "," + key}) {
    const auto refused = refusal(text);
    EXPECT_TRUE(refused == ErrorCode::kRefusedKey || refused == ErrorCode::kMissingKey) << text;
  }
  for (const std::string& text : {"Bearer " + key, "bearer " + key, "BEARER  " + key + " "})
    EXPECT_EQ(refusal(text), std::nullopt) << text;
  // Nowhere else than in the header, where no log and no history keeps it.
  HttpRequest in_query = request("GET", "/v1/maps");
  in_query.query = {{"key", key}, {"access_token", key}};
  EXPECT_EQ(refusal(in_query, ""), ErrorCode::kMissingKey);
}

TEST_F(GatekeeperTest, WhatAnotherProcessDoesToKeysCountsAtOnce) {
  start();
  PackageStore other(store_.folder().path());
  EXPECT_EQ(refusal(""), std::nullopt);
  const auto made = other.keys().create("test", only(KeyScope::kRead), {}, now_ns());
  EXPECT_EQ(refusal(""), ErrorCode::kMissingKey);
  EXPECT_EQ(refusal("Bearer " + made.text), std::nullopt);
  other.keys().revoke(made.key.id, now_ns());
  EXPECT_EQ(refusal("Bearer " + made.text), ErrorCode::kRefusedKey);
}

TEST_F(GatekeeperTest, LargeBodiesNeedAPlaceBeforeTheyAreRead) {
  start();
  for (const Route* route : service_->routes()) {
    if (route->body != BodyKind::kWhole || route->reserve) continue;
    EXPECT_GT(route->max_body_bytes, 0U) << route->pattern;
    EXPECT_LE(route->max_body_bytes, std::uint64_t{4} << 20U) << route->pattern;
  }
}

TEST_F(GatekeeperTest, RebuildsAreLookedAtTwoAtATime) {
  start();
  HttpRequest one = request("POST", "/v1/maps/town/rebuild");
  HttpRequest two = one;
  (void)service_->admit(one);
  (void)service_->admit(two);
  EXPECT_EQ(refusal(request("POST", "/v1/maps/town/rebuild"), ""), ErrorCode::kBusy);
  two.reservation.reset();
  EXPECT_EQ(refusal(request("POST", "/v1/maps/town/rebuild"), ""), std::nullopt);
}

TEST_F(GatekeeperTest, PagesOfOtherSitesChangeNothingWhereNoKeyIsAskedFor) {
  start();
  const auto from = [&](const std::string& site, const std::string& method) {
    HttpRequest asked =
        request(method, method == "POST" ? "/v1/maps/town/rollback" : "/v1/maps/town");
    asked.headers["sec-fetch-site"] = site;
    return refusal(asked, "");
  };
  EXPECT_EQ(from("cross-site", "POST"), ErrorCode::kForbidden);
  EXPECT_EQ(from("same-site", "DELETE"), ErrorCode::kForbidden);
  EXPECT_EQ(from("same-origin", "POST"), std::nullopt);
  EXPECT_EQ(from("none", "DELETE"), std::nullopt);
  EXPECT_EQ(from("cross-site", "GET"), std::nullopt);
}

TEST_F(GatekeeperTest, OriginsOfOtherSitesChangeNothingWhereNoKeyIsAskedFor) {
  start();
  const auto from = [&](const std::string& origin, const std::string& host = "localhost:8080",
                        const std::string& method = "POST") {
    HttpRequest asked =
        request(method, "/v1/maps/town" + std::string(method == "POST" ? "/rollback" : ""));
    asked.headers["origin"] = origin;
    asked.headers["host"] = host;
    return refusal(asked, "");
  };
  for (const char* other :
       {"http://evil.example", "http://localhost", "http://localhost:8081", "https://localhost",
        "null", "", "localhost:8080", "://", "http://", "http://localhost:8080.evil.example"}) {
    EXPECT_EQ(from(other), ErrorCode::kForbidden) << other;
    EXPECT_EQ(from(other, "localhost:8080", "DELETE"), ErrorCode::kForbidden) << other;
    EXPECT_EQ(from(other, "localhost:8080", "GET"), std::nullopt) << other;
  }
  EXPECT_EQ(from("http://"), ErrorCode::kForbidden);
  EXPECT_EQ(from("http://localhost:8080"), std::nullopt);
  EXPECT_EQ(from("HTTP://LOCALHOST:8080"), std::nullopt);
  EXPECT_EQ(from("http://localhost", "localhost"), std::nullopt);
  EXPECT_EQ(from("http://localhost", "localhost:80"), std::nullopt);
  EXPECT_EQ(from("https://localhost:443", "localhost"), std::nullopt);
  EXPECT_EQ(from("http://localhost:443", "localhost"), ErrorCode::kForbidden);
  EXPECT_EQ(from("http://[::1]:8080", "[::1]:8080"), std::nullopt);
  // Scripts and our clients send none.
  EXPECT_EQ(refusal(request("POST", "/v1/maps/town/rollback"), ""), std::nullopt);
}

TEST_F(GatekeeperTest, PagesOfOtherSitesChangeNothingWhereOtherMachinesNeedNoKeyEither) {
  options_.host = "0.0.0.0";
  options_.allow_remote = true;
  options_.allow_without_keys = true;
  start();
  HttpRequest asked = request("POST", "/v1/maps/town/rollback");
  asked.headers["host"] = "maps.example.org";
  asked.headers["origin"] = "http://evil.example";
  EXPECT_EQ(refusal(asked, ""), ErrorCode::kForbidden);
  asked.headers["origin"] = "http://maps.example.org";
  EXPECT_EQ(refusal(asked, ""), std::nullopt);
  asked.headers["sec-fetch-site"] = "cross-site";
  EXPECT_EQ(refusal(asked, ""), ErrorCode::kForbidden);
}

/// A form of another site's page can send text/plain, not JSON.
TEST_F(GatekeeperTest, RoutesThatTakeJsonTakeItsTypeAlone) {
  options_.sessions.max = 10;
  start();
  const std::string key = "Bearer " + make_key({15});
  const std::set<std::string> with_optional_body = {
      "/v1/maps/{map}/drives", "/v1/maps/{map}/drives/{drive}/complete", "/v1/sessions",
      "/v1/sessions/{session}/initialize"};
  int tried = 0;
  for (const Route* route : service_->routes()) {
    // Poses take other types too, and streamed bodies are bytes.
    const bool is_pose =
        route->pattern.find("/localize") != std::string::npos || route->pattern.ends_with("/scans");
    if (route->body != BodyKind::kWhole || is_pose) continue;
    ++tried;
    for (const char* type : {"text/plain", "application/x-www-form-urlencoded",
                             "multipart/form-data; boundary=a", "", "application/jsonp"}) {
      HttpRequest asked = request_to(*route);
      asked.headers["authorization"] = key;
      asked.headers["content-type"] = type;
      asked.body = "{}";
      EXPECT_EQ(service_->handle(asked).status, 415) << route->pattern << " " << type;
      asked.body.clear();
      if (!with_optional_body.contains(route->pattern)) {
        EXPECT_EQ(service_->handle(asked).status, 415) << route->pattern << " " << type;
      }
    }
  }
  EXPECT_GE(tried, 7);
}

TEST_F(GatekeeperTest, TheFirstKeyIsNotMadeOverHttp) {
  start();
  HttpRequest asked = request("POST", "/v1/keys");
  asked.headers["content-type"] = "application/json";
  asked.body = R"({"name": "mine", "scopes": ["admin"]})";
  const HttpResponse refused = service_->handle(asked);
  EXPECT_EQ(refused.status, 403);
  EXPECT_THAT(refused.body, ::testing::HasSubstr("stillmap keys create"));
  EXPECT_TRUE(store_.open().keys().list().empty());
  asked.headers["authorization"] = "Bearer " + make_key(only(KeyScope::kAdmin));
  EXPECT_EQ(service_->handle(asked).status, 201);
}

TEST_F(GatekeeperTest, NamesThatAreNotOfThisMachineAreNotAnsweredWithoutKeys) {
  start();
  const auto asked_as = [&](const std::string& host, const std::string& path = "/v1/maps") {
    HttpRequest asked = request("GET", path);
    asked.headers["host"] = host;
    return refusal(asked, "");
  };
  for (const char* here :
       {"localhost", "LOCALHOST:8080", "127.0.0.1:8080", "127.1.2.3", "[::1]", "[::1]:8080", ""})
    EXPECT_EQ(asked_as(here), std::nullopt) << here;
  for (const char* elsewhere :
       {"maps.example.org", "maps.example.org:8080", "127.example.org", "localhost.example.org",
        "10.0.0.1", "[::2]:80", "[", "[]", ":80", "::1:80"})
    EXPECT_EQ(asked_as(elsewhere), ErrorCode::kForbidden) << elsewhere;
  EXPECT_EQ(asked_as("maps.example.org", "/livez"), std::nullopt);
  const std::string key = make_key(only(KeyScope::kRead));
  HttpRequest with_key = request("GET", "/v1/maps");
  with_key.headers["host"] = "maps.example.org";
  EXPECT_EQ(refusal(with_key, "Bearer " + key), std::nullopt);
}

TEST_F(GatekeeperTest, AnyNameIsAnsweredWhereTheServerListensForOthers) {
  options_.host = "0.0.0.0";
  options_.allow_remote = true;
  options_.allow_without_keys = true;
  start();
  HttpRequest asked = request("GET", "/v1/maps");
  asked.headers["host"] = "maps.example.org";
  EXPECT_EQ(refusal(asked, ""), std::nullopt);
}

TEST_F(GatekeeperTest, WritesThatWereNotAllowedAreInTheAuditLog) {
  start();
  const auto reader = store_.open().keys().create("test", only(KeyScope::kRead), {}, now_ns());
  const auto records = [&] { return store_.open().audit().list(1000).records; };
  HttpRequest write = request("POST", "/v1/maps/town/rollback");
  EXPECT_EQ(refusal(write, ""), ErrorCode::kMissingKey);
  ASSERT_EQ(records().size(), 1U);
  EXPECT_EQ(records()[0].status, 401);
  EXPECT_EQ(records()[0].key_id, "");
  EXPECT_EQ(refusal(write, "Bearer " + reader.text), ErrorCode::kForbidden);
  ASSERT_EQ(records().size(), 2U);
  EXPECT_EQ(records()[0].status, 403);
  EXPECT_EQ(records()[0].key_id, reader.key.id);
  EXPECT_EQ(records()[0].subject, "town");
  EXPECT_EQ(refusal(request("GET", "/v1/maps"), ""), ErrorCode::kMissingKey);
  EXPECT_EQ(records().size(), 2U);
  for (int i = 0; i < 300; ++i) EXPECT_EQ(refusal(write, ""), ErrorCode::kMissingKey);
  EXPECT_LT(records().size(), 200U) << "whoever has no key must not fill the disk";
}

TEST_F(GatekeeperTest, OneKeyHoldsHalfOfTheUploadsAtMost) {
  options_.uploads.max_open = 4;
  start();
  const std::string one = "Bearer " + make_key(only(KeyScope::kWrite));
  const std::string other = "Bearer " + make_key(only(KeyScope::kWrite));
  std::vector<HttpRequest> held;
  const auto upload = [&](const std::string& key) -> std::optional<ErrorCode> {
    HttpRequest asked = request("PUT", "/v1/maps/town/versions/v2");
    asked.headers["authorization"] = key;
    try {
      (void)service_->admit(asked);
      held.push_back(asked);
      return std::nullopt;
    } catch (const ApiError& error) {
      return error.code();
    }
  };
  EXPECT_EQ(upload(one), std::nullopt);
  EXPECT_EQ(upload(one), std::nullopt);
  EXPECT_EQ(upload(one), ErrorCode::kTooManyRequests);
  EXPECT_EQ(upload(other), std::nullopt);
  EXPECT_EQ(upload(other), std::nullopt);
  EXPECT_EQ(upload(other), ErrorCode::kBusy);
  held.clear();
  EXPECT_EQ(upload(one), std::nullopt);
}

TEST_F(GatekeeperTest, EventStreamsEndWithTheirKey) {
  start();
  KeyTable& keys = store_.open().keys();
  HttpRequest opening = request("POST", "/v1/sessions");
  opening.headers["content-type"] = "application/json";
  opening.body = R"({"map": "town"})";
  const auto open_stream = [&](const std::string& authorization) {
    opening.headers["authorization"] = authorization;
    const auto session = body(service_->handle(opening));
    HttpRequest asked =
        request("GET", "/v1/sessions/" + session["id"].get<std::string>() + "/events");
    asked.headers["authorization"] = authorization;
    return service_->handle(asked).events;
  };
  const auto keyless = open_stream("");
  EXPECT_TRUE(keyless->next(milliseconds(1)).has_value());
  const auto made = keys.create("vehicle", only(KeyScope::kLocalize), {}, now_ns());
  EXPECT_FALSE(keyless->next(milliseconds(1)).has_value());
  const auto stream = open_stream("Bearer " + made.text);
  EXPECT_TRUE(stream->next(milliseconds(1)).has_value());
  keys.revoke(made.key.id, now_ns());
  EXPECT_FALSE(stream->next(milliseconds(1)).has_value());
}

TEST_F(GatekeeperTest, KeyBeyondItsRateWaitsAndTheOthersDoNot) {
  options_.rate = {.requests_per_s = 0.01, .burst = 2};
  start();
  const std::string one = make_key(only(KeyScope::kRead));
  const std::string two = make_key(only(KeyScope::kRead));
  HttpRequest asked = request("GET", "/v1/maps");
  asked.headers["authorization"] = "Bearer " + one;
  EXPECT_EQ(service_->handle(asked).status, 200);
  EXPECT_EQ(service_->handle(asked).status, 200);
  const HttpResponse refused = service_->handle(asked);
  EXPECT_EQ(refused.status, 429);
  EXPECT_EQ(body(refused)["code"], "TooManyRequests");
  EXPECT_THAT(refused.headers, Contains(Pair("Retry-After", "100")));
  EXPECT_EQ(refusal("Bearer " + two), std::nullopt);
  // Health is not counted.
  for (int i = 0; i < 10; ++i) EXPECT_EQ(get("/livez").status, 200);
}

TEST_F(GatekeeperTest, AddressBeyondItsRateWaitsWhereThereAreNoKeys) {
  options_.rate = {.requests_per_s = 0.01, .burst = 2};
  options_.host = "0.0.0.0";
  options_.allow_remote = true;
  start();
  const auto ask = [&](const std::string& from, const std::string& path = "/v1/maps") {
    HttpRequest asked = request("GET", path);
    asked.remote_address = from;
    return service_->handle(asked).status;
  };
  for (const int status : {200, 200, 429}) EXPECT_EQ(ask("192.0.2.1"), status);
  EXPECT_EQ(ask("192.0.2.1", "/livez"), 200);
  for (const int status : {200, 200, 429}) EXPECT_EQ(ask("192.0.2.2"), status);
  // Who has one address of IPv6 has 2^64 of them.
  for (const int status : {200, 200, 429})
    EXPECT_EQ(ask("2001:db8::" + std::to_string(status)), status);
  for (int i = 0; i < 5; ++i) {
    EXPECT_EQ(ask("127.0.0.1"), 200);
    EXPECT_EQ(ask("::1"), 200);
    EXPECT_EQ(ask(""), 200);
  }
  const std::string key = "Bearer " + make_key(only(KeyScope::kRead));
  HttpRequest with_key = request("GET", "/v1/maps");
  with_key.headers["authorization"] = key;
  with_key.remote_address = "192.0.2.1";
  EXPECT_EQ(service_->handle(with_key).status, 200) << "the key's rate counts";
}

TEST(AddressRates, TakeNoMoreMemoryForMoreAddresses) {
  AddressRates rates;
  const RateOptions rate{.requests_per_s = 1.0, .burst = 1};
  const TokenBucket::Clock::time_point start{};
  std::size_t let_in = 0;
  for (std::size_t i = 0; i < 20 * AddressRates::kBuckets; ++i)
    let_in += rates.take(std::to_string(i), rate, start) == 0.0 ? 1 : 0;
  EXPECT_EQ(let_in, AddressRates::kBuckets);
}

TEST(RateLimits, FillsWithTimeUpToTheBurst) {
  RateLimits limits;
  const RateOptions rate{.requests_per_s = 10.0, .burst = 2};
  const RateLimits::Clock::time_point start{};
  EXPECT_EQ(limits.take("a", rate, start), 0.0);
  EXPECT_EQ(limits.take("a", rate, start), 0.0);
  EXPECT_NEAR(limits.take("a", rate, start), 0.1, 1e-9);
  EXPECT_NEAR(limits.take("a", rate, start + milliseconds(40)), 0.06, 1e-9);
  EXPECT_EQ(limits.take("a", rate, start + milliseconds(101)), 0.0);
  // A clock that seems to go back gives nothing.
  EXPECT_GT(limits.take("a", rate, start), 0.0);
  const auto later = start + std::chrono::hours(1);
  EXPECT_EQ(limits.take("a", rate, later), 0.0);
  EXPECT_EQ(limits.take("a", rate, later), 0.0);
  EXPECT_GT(limits.take("a", rate, later), 0.0);
  EXPECT_EQ(limits.take("a", {.requests_per_s = 0.0, .burst = 1}, later), 0.0);
}

}  // namespace gatekeeper_test
}  // namespace stillmap::server
