#include "config/option_table.hpp"

#include <gmock/gmock.h>

#include <fstream>
#include <limits>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "config/config_sources.hpp"
#include "config/config_text.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::server {
namespace option_table_test {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::string text_of(const std::string& name) {
  std::ifstream file(std::string(STILLMAP_SERVER_FOLDER) + "/" + name);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

/// A value that is allowed and not the default.
OptionValue another(const Option& option) {
  ServerOptions options;
  const OptionValue before = option.get(options);
  switch (option.kind()) {
    case OptionKind::kFlag:
      return !std::get<bool>(before);
    case OptionKind::kInteger: {
      const std::int64_t value = std::get<std::int64_t>(before);
      return static_cast<double>(value) < option.most ? value + 1 : value - 1;
    }
    case OptionKind::kReal:
      return std::get<double>(before) == option.least ? option.most : option.least;
    case OptionKind::kChoice:
      return std::string(option.choices.front() == std::get<std::string>(before)
                             ? option.choices.back()
                             : option.choices.front());
    case OptionKind::kText:
      break;
  }
  return std::string("/another/text");
}

std::string plain(const OptionValue& value) {
  const auto* text = std::get_if<std::string>(&value);
  return text != nullptr
             ? *text
             : std::visit([](const auto& each) { return nlohmann::json(each).dump(); }, value);
}

TEST(OptionTable, NamesAreUniqueAndEachFieldHasOne) {
  std::set<std::string> names;
  std::set<const void*> fields;
  ServerOptions options;
  for (const Option& option : all_options()) {
    EXPECT_TRUE(names.insert(std::string(option.key)).second) << option.key;
    EXPECT_TRUE(names.insert(option.flag()).second) << option.flag();
    EXPECT_TRUE(names.insert(option.variable()).second) << option.variable();
    const void* field =
        std::visit([](auto* where) -> const void* { return where; }, option.field(options));
    EXPECT_TRUE(fields.insert(field).second) << option.key;
    EXPECT_EQ(find_option(option.key), &option);
    EXPECT_THAT(option.text, ::testing::EndsWith("."));
  }
  EXPECT_EQ(find_option("no_such_option"), nullptr);
  EXPECT_EQ(find_option("sessions.idle_expiry_s")->flag(), "--sessions-idle-expiry-s");
  EXPECT_EQ(find_option("sessions.idle_expiry_s")->variable(),
            "STILLMAP_SERVE_SESSIONS_IDLE_EXPIRY_S");
}

TEST(OptionTable, BoundsHoldTheDefaultAndFitTheField) {
  for (const Option& option : all_options()) {
    ServerOptions options;
    EXPECT_TRUE(option.set(options, option.get(ServerOptions{}))) << option.key;
    if (option.kind() != OptionKind::kInteger) continue;
    std::visit(
        [&option](auto* where) {
          using Value = std::remove_reference_t<decltype(*where)>;
          if constexpr (std::is_integral_v<Value>) {
            EXPECT_GE(option.least, static_cast<double>(std::numeric_limits<Value>::min()));
            EXPECT_LE(option.most, static_cast<double>(std::numeric_limits<Value>::max()));
          }
        },
        option.field(options));
  }
}

TEST(OptionTable, RefusesWhatIsOutOfBoundsOrOfAnotherKind) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const double infinity = std::numeric_limits<double>::infinity();
  for (const Option& option : all_options()) {
    const OptionKind kind = option.kind();
    std::vector<OptionValue> wrong = {nan, infinity, -infinity, 1e300};
    if (kind == OptionKind::kInteger || kind == OptionKind::kReal) {
      wrong.insert(wrong.end(), {option.least - 1.0, option.most * 2 + 1, true, std::string("1")});
      if (kind == OptionKind::kInteger) wrong.emplace_back(option.least + 0.5);
    } else if (kind == OptionKind::kFlag) {
      wrong.insert(wrong.end(), {std::int64_t{1}, std::string("true")});
    } else {
      wrong.insert(wrong.end(), {std::int64_t{1}, true, std::string("a\nb"), std::string(4097, 'x'),
                                 std::string("a\0b", 3)});
    }
    for (const OptionValue& value : wrong) {
      ServerOptions options;
      EXPECT_FALSE(option.set(options, value)) << option.key << " " << plain(value);
      EXPECT_EQ(option.get(options), option.get(ServerOptions{})) << option.key;
    }
  }
}

std::string file_with(const Option& option, const OptionValue& value) {
  const std::string json =
      std::visit([](const auto& v) { return nlohmann::json(v).dump(); }, value);
  const std::string key(option.key);
  const std::size_t dot = key.find('.');
  if (dot == std::string::npos) return "{\"" + key + "\": " + json + "}";
  return "{\"" + key.substr(0, dot) + "\": {\"" + key.substr(dot + 1) + "\": " + json + "}}";
}

TEST(OptionTable, EachComesFromFileEnvironmentAndFlag) {
  const test::TemporaryFolder folder;
  for (const Option& option : all_options()) {
    const std::string key(option.key);
    const OptionValue value = another(option);
    ASSERT_NE(value, option.get(ServerOptions{})) << key;
    const auto file = folder.write("config.json", file_with(option, value));
    const std::vector<std::pair<std::string, ConfigSources>> sources = {
        {file.string(), {.file = file, .environment = {}, .flags = {}}},
        {option.variable(),
         {.file = {}, .environment = {{option.variable(), plain(value)}}, .flags = {}}},
        {option.flag(), {.file = {}, .environment = {}, .flags = {{key, plain(value)}}}}};
    for (const auto& [origin, from] : sources) {
      const ResolvedConfig config = resolve(from);
      EXPECT_EQ(option.get(config.options), value) << key << " from " << origin;
      ASSERT_EQ(config.origins.count(key), 1U) << key << " from " << origin;
      EXPECT_EQ(config.origins.at(key), origin);
    }
  }
}

TEST(OptionTable, SchemaSaysTheSame) {
  const nlohmann::json schema = nlohmann::json::parse(config_schema());
  EXPECT_EQ(schema["additionalProperties"], false);
  std::size_t leaves = 0;
  for (const auto& [name, each] : schema["properties"].items()) {
    leaves += each.contains("properties") ? each["properties"].size() : 1;
  }
  EXPECT_EQ(leaves, all_options().size());
  for (const Option& option : all_options()) {
    nlohmann::json place = schema;
    std::istringstream path{std::string(option.key)};
    for (std::string part; std::getline(path, part, '.');) place = place["properties"][part];
    EXPECT_THAT(place["description"].get<std::string>(), HasSubstr(std::string(option.text)));
    std::visit([&](const auto& value) { EXPECT_EQ(place["default"], value) << option.key; },
               option.get(ServerOptions{}));
    if (place.contains("minimum")) {
      EXPECT_EQ(place["minimum"].get<double>(), option.least) << option.key;
      EXPECT_EQ(place["maximum"].get<double>(), option.most) << option.key;
    }
    EXPECT_EQ(place.contains("enum"), option.kind() == OptionKind::kChoice) << option.key;
  }
}

TEST(OptionTable, SchemaAndPageInTheRepositoryAreOfToday) {
  EXPECT_TRUE(text_of("config.schema.json") == config_schema())
      << "stillmap serve --print-schema > server/config.schema.json";
  EXPECT_TRUE(text_of("configuration.md") == config_page())
      << "stillmap serve --print-page > server/configuration.md";
}

TEST(BrokenOptions, WhatDoesNotGoTogetherIsNamedWithBoth) {
  struct Case {
    std::string key;
    std::string other;
    ServerOptions options;
  };
  std::vector<Case> cases;
  const auto add = [&cases](std::string key, std::string other, auto change) {
    ServerOptions options;
    change(options);
    cases.push_back({std::move(key), std::move(other), std::move(options)});
  };
  add("host", "allow_remote", [](ServerOptions& o) { o.host = "0.0.0.0"; });
  add("management.host", "allow_remote",
      [](ServerOptions& o) { o.management = {.host = "::", .port = 0}; });
  add("management.port", "port", [](ServerOptions& o) { o.management.port = o.port; });
  add("tls.key_file", "tls.certificate_file",
      [](ServerOptions& o) { o.tls.certificate_file = "c.pem"; });
  add("tls.certificate_file", "tls.key_file", [](ServerOptions& o) { o.tls.key_file = "k.pem"; });
  add("max_json_bytes", "max_payload_bytes", [](ServerOptions& o) { o.max_payload_bytes = 4096; });
  add("max_scan_points", "min_scan_points", [](ServerOptions& o) { o.max_scan_points = 1; });
  add("event_streams", "connections", [](ServerOptions& o) { o.connections = o.event_streams; });
  add("transfer_timeout_s", "stall_timeout_s", [](ServerOptions& o) { o.stall_timeout_s = 61; });
  add("quotas.map_bytes", "quotas.store_bytes",
      [](ServerOptions& o) { o.quotas = {.store_bytes = 10, .map_bytes = 11}; });
  for (const Case& each : cases) {
    const std::vector<BrokenOption> broken = broken_options(each.options);
    ASSERT_EQ(broken.size(), 1U) << each.key;
    EXPECT_EQ(broken[0].key, each.key);
    EXPECT_EQ(broken[0].other, each.other);
    EXPECT_THAT(broken[0].expected, HasSubstr(each.other));
  }
  EXPECT_THAT(broken_options({}), IsEmpty());
}

}  // namespace option_table_test
}  // namespace stillmap::server
