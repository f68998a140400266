// server/openapi.json and the routes are held against each other.
#include <gmock/gmock.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <regex>
#include <set>

#include "errors/error_codes.hpp"
#include "handlers/openapi_document.hpp"
#include "service_fixture.hpp"

namespace stillmap::server {
namespace openapi_test {

using nlohmann::json;

const json& document() {
  static const json text = json::parse(openapi_document());
  return text;
}

/// What `$ref` points at, or the value itself.
const json& resolved(const json& value) {
  const auto ref = value.find("$ref");
  if (ref == value.end()) return value;
  return document().at(json::json_pointer(ref->get<std::string>().substr(1)));
}

struct Operation {
  std::string method, path;
  json text;
};

std::vector<Operation> operations() {
  std::vector<Operation> each;
  for (const auto& [path, item] : document()["paths"].items()) {
    for (const char* method : {"get", "put", "post", "delete"}) {
      if (!item.contains(method)) continue;
      std::string upper(method);
      std::transform(upper.begin(), upper.end(), upper.begin(), ::toupper);
      each.push_back({upper, path, item[method]});
      json& parameters = each.back().text["parameters"];
      if (parameters.is_null()) parameters = json::array();
      for (const json& shared : item.value("parameters", json::array()))
        parameters.push_back(shared);
    }
  }
  return each;
}

std::set<std::string> parameters_in(const std::string& path) {
  std::set<std::string> names;
  const std::regex part("\\{([a-z_]+)\\}");
  for (std::sregex_iterator each(path.begin(), path.end(), part), end; each != end; ++each)
    names.insert((*each)[1]);
  return names;
}

/// As the document says it: any of them will do.
json scopes_of(Access access) {
  const auto key = [](const char* scope) { return json{{"key", {scope}}}; };
  switch (access) {
    case Access::kOpen:
    case Access::kOpenWithNames:
      return json::array();
    case Access::kRead:
      return json::array({key("read")});
    case Access::kLocalize:
      return json::array({key("localize")});
    case Access::kWrite:
      return json::array({key("write")});
    case Access::kReadOrLocalize:
      return json::array({key("read"), key("localize")});
    case Access::kLocalizeOrAdmin:
      return json::array({key("localize"), key("admin")});
    case Access::kAdmin:
      break;
  }
  return json::array({key("admin")});
}

class OpenApi : public ServiceTest {
 protected:
  /// Of the interface, without the page.
  std::vector<const Route*> routes() const {
    std::vector<const Route*> each = service_->routes();
    std::erase_if(each, [](const Route* route) { return route->pattern == "/"; });
    return each;
  }
  const Route* route(const Operation& operation) const {
    for (const Route* each : routes())
      if (each->method == operation.method && each->pattern == operation.path) return each;
    return nullptr;
  }
};

TEST_F(OpenApi, EveryRouteIsDescribedAndNothingElse) {
  start();
  std::set<std::pair<std::string, std::string>> described, served;
  for (const Operation& each : operations()) described.emplace(each.path, each.method);
  for (const Route* each : routes()) served.emplace(each->pattern, each->method);
  EXPECT_EQ(described, served);
}

TEST_F(OpenApi, PathParametersAreThoseOfThePath) {
  for (const Operation& each : operations()) {
    std::set<std::string> described;
    for (const json& reference : each.text["parameters"]) {
      const json& parameter = resolved(reference);
      if (parameter["in"] != "path") continue;
      described.insert(parameter["name"]);
      EXPECT_EQ(parameter["required"], true) << each.path;
    }
    EXPECT_EQ(described, parameters_in(each.path)) << each.path;
  }
}

TEST_F(OpenApi, ScopesAreThoseThatAreAskedFor) {
  start();
  for (const Operation& each : operations()) {
    const Route* const served = route(each);
    ASSERT_NE(served, nullptr) << each.path;
    const json expected = scopes_of(served->access);
    EXPECT_EQ(each.text["security"], expected) << each.method << " " << each.path;
    const bool says_401 = each.text["responses"].contains("401");
    EXPECT_EQ(says_401, !expected.empty()) << each.path;
    EXPECT_EQ(each.text["responses"].contains("403"), !expected.empty()) << each.path;
  }
}

TEST_F(OpenApi, BodiesAreDescribedWhereTheyAreRead) {
  start();
  for (const Operation& each : operations()) {
    const Route* const served = route(each);
    ASSERT_NE(served, nullptr) << each.path;
    EXPECT_EQ(each.text.contains("requestBody"), served->body != BodyKind::kNone)
        << each.method << " " << each.path;
    EXPECT_EQ(each.text["responses"].contains("413"), served->body != BodyKind::kNone) << each.path;
  }
}

TEST_F(OpenApi, ErrorCodesAreThoseOfTheTableBesideTheirStatus) {
  std::map<std::string, int> status;
  for (const ErrorInfo& info : all_errors()) status[std::string(info.text)] = info.http_status;
  std::set<std::string> in_schema;
  for (const json& code :
       document()["components"]["schemas"]["Problem"]["properties"]["code"]["enum"])
    in_schema.insert(code.get<std::string>());
  std::set<std::string> in_table;
  for (const auto& [code, http_status] : status) in_table.insert(code);
  EXPECT_EQ(in_schema, in_table);

  const std::regex word("`([A-Z][A-Za-z]+)`");
  for (const Operation& each : operations()) {
    for (const auto& [number, reference] : each.text["responses"].items()) {
      if (number == "default" || number < "400") continue;
      // Health says 503 in its own words.
      if (!resolved(reference)
               .value("content", json::object())
               .contains("application/problem+json"))
        continue;
      const std::string text = resolved(reference)["description"];
      EXPECT_TRUE(std::regex_search(text, word)) << each.path << " " << number;
      for (std::sregex_iterator found(text.begin(), text.end(), word), end; found != end; ++found) {
        const auto known = status.find((*found)[1]);
        ASSERT_NE(known, status.end()) << each.path << " " << text;
        EXPECT_EQ(std::to_string(known->second), number) << each.path << " " << text;
      }
    }
  }
}

TEST_F(OpenApi, OperationsHaveNamesOfTheirOwn) {
  std::set<std::string> names;
  for (const Operation& each : operations())
    EXPECT_TRUE(names.insert(each.text.at("operationId")).second) << each.text["operationId"];
}

TEST_F(OpenApi, DocumentIsServedAndKept) {
  start();
  const HttpResponse response = get("/openapi.json");
  ASSERT_EQ(response.status, 200);
  EXPECT_EQ(response.content_type, "application/json");
  EXPECT_EQ(response.body, openapi_document());
  HttpRequest again = request("GET", "/openapi.json");
  for (const auto& [name, value] : response.headers)
    if (name == "ETag") again.headers["if-none-match"] = value;
  ASSERT_TRUE(again.headers.contains("if-none-match"));
  EXPECT_EQ(service_->handle(again).status, 304);
  EXPECT_EQ(document()["openapi"], "3.1.0");
}

}  // namespace openapi_test
}  // namespace stillmap::server
