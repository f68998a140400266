#include <gmock/gmock.h>

#include <fstream>
#include <stdexcept>
#include <stillmap/server/options_holder.hpp>

#include "config/config_file.hpp"
#include "config/config_sources.hpp"
#include "config/config_text.hpp"
#include "config/reload.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::server {
namespace config_test {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::Each;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Key;
using ::testing::Not;
using ::testing::SizeIs;
using ::testing::StartsWith;
using ::testing::UnorderedElementsAre;

std::vector<std::string> problems_of(std::string_view text) {
  std::vector<std::string> result;
  for (const ConfigProblem& each : parse_config(text, "f").problems) result.push_back(each.text());
  return result;
}

std::vector<std::string> texts(const std::vector<ConfigProblem>& problems) {
  std::vector<std::string> result;
  for (const ConfigProblem& each : problems) result.push_back(each.text());
  return result;
}

class ConfigTest : public ::testing::Test {
 protected:
  ConfigSources with_file(const std::string& text) {
    return {.file = folder_.write("config.json", text), .environment = {}, .flags = {}};
  }
  test::TemporaryFolder folder_;
};

TEST_F(ConfigTest, FlagWinsOverEnvironmentOverFileOverDefault) {
  ConfigSources sources =
      with_file(R"({"port": 1, "queue": 1, "workers": 1, "log": {"level": "debug"}})");
  sources.environment = {{"STILLMAP_SERVE_PORT", "2"}, {"STILLMAP_SERVE_QUEUE", "2"}};
  sources.flags = {{"port", "3"}};
  const ResolvedConfig config = resolve(sources);
  EXPECT_THAT(texts(config.problems), IsEmpty());
  EXPECT_EQ(config.options.port, 3);
  EXPECT_EQ(config.options.queue, 2);
  EXPECT_EQ(config.options.workers, 1);
  EXPECT_EQ(config.options.log.level, "debug");
  EXPECT_EQ(config.options.connections, ServerOptions{}.connections);
  EXPECT_EQ(config.origins.at("port"), "--port");
  EXPECT_EQ(config.origins.at("queue"), "STILLMAP_SERVE_QUEUE");
  EXPECT_EQ(config.origins.at("workers"), sources.file->string());
  EXPECT_EQ(config.origins.count("connections"), 0U);
}

TEST_F(ConfigTest, CommentsMayStandInTheFile) {
  EXPECT_THAT(problems_of("// one\n{ /* two */ \"port\": 1 // three\n}\n"), IsEmpty());
}

TEST_F(ConfigTest, EveryProblemOfEverySourceIsNamedAtOnce) {
  ConfigSources sources = with_file(
      R"({"prot": 1, "port": "x", "jobs": {"nice": 20, "retires": 1}, "queue": [1], "tls": 1})");
  sources.environment = {{"STILLMAP_SERVE_WORKERS", "many"}, {"STILLMAP_SERVE_LOG_LEVL", "info"}};
  sources.flags = {{"connections", "10"}, {"log.format", "xml"}};
  const std::string file = sources.file->string();
  EXPECT_THAT(
      texts(resolve(sources).problems),
      UnorderedElementsAre(
          file + ": \"prot\": found 1, expected a known key, the nearest is port",
          file + ": port: found \"x\", expected an integer in [0, 65535]",
          file + ": jobs.nice: found 20, expected an integer in [0, 19]",
          file + ": \"jobs.retires\": found 1, expected a known key, the nearest is jobs.retries",
          file + ": queue: found an array, expected an integer in [0, 10000]",
          file + ": tls: found 1, expected an object of options",
          "environment: STILLMAP_SERVE_WORKERS: found \"many\", expected an integer in [0, 1024]",
          "environment: \"STILLMAP_SERVE_LOG_LEVL\": found \"info\", expected a known variable, "
          "the nearest is STILLMAP_SERVE_LOG_LEVEL",
          "command line: --log-format: found \"xml\", expected one of text, json",
          "default: event_streams: found 64, expected below connections (connections is 10)"));
}

TEST_F(ConfigTest, WhatWasRefusedIsNotJudgedByItsDefault) {
  // With its default, connections, this would not go together.
  ConfigSources sources = with_file(R"({"connections": "many", "event_streams": 1000})");
  EXPECT_THAT(texts(resolve(sources).problems), ElementsAre(HasSubstr(": connections:")));
}

TEST(ConfigFile, IntegersMayBeWrittenAsWholeReals) {
  const ConfigText text = parse_config(R"({"uploads": {"max_package_bytes": 1e9}})", "f");
  ASSERT_THAT(text.values, SizeIs(1));
  ServerOptions options;
  EXPECT_TRUE(text.values[0].first->set(options, text.values[0].second));
  EXPECT_EQ(options.uploads.max_package_bytes, 1'000'000'000);
}

TEST(ConfigFile, RefusesWhatIsNoJson) {
  for (const char* text : {"", "{", "{\"port\": 1,}", "{port: 1}", "{\"port\": NaN}",
                           "{\"port\": Infinity}", "{\"port\": 0x10}", "{} {}", "\xff\xfe{}",
                           "{\"host\": \"\xc3\x28\"}", "{\"port\": 1e999}", "/* {}", "\0{}"}) {
    EXPECT_THAT(problems_of(text), ElementsAre(HasSubstr("expected JSON, comments allowed")))
        << text;
  }
}

TEST(ConfigFile, RefusesWrongTypesAndHugeNumbers) {
  for (const char* value : {"null", "true", "\"1\"", "[]", "{}", "-1", "65536", "1.5", "1e300",
                            "99999999999999999999999", "18446744073709551615",
                            "9223372036854775808", "-9223372036854775809"}) {
    EXPECT_THAT(problems_of(std::string("{\"port\": ") + value + "}"),
                ElementsAre(HasSubstr("f: port: found ")))
        << value;
  }
  for (const char* text : {"null", "1", "\"x\"", "[]", "[{\"port\": 1}]", "true"}) {
    EXPECT_THAT(problems_of(text), ElementsAre(HasSubstr("expected an object of options"))) << text;
  }
}

TEST(ConfigFile, RefusesDoubledKeysAlsoOfGroups) {
  EXPECT_THAT(problems_of(R"({"port": 1, "port": 1})"),
              ElementsAre("f: port: found it twice, expected it once"));
  EXPECT_THAT(problems_of(R"({"log": {"level": "info"}, "log": {"format": "json"}})"),
              ElementsAre("f: log: found it twice, expected it once"));
  EXPECT_THAT(problems_of(R"({"log": {"level": "info", "level": "info"}})"),
              ElementsAre("f: log.level: found it twice, expected it once"));
}

TEST(ConfigFile, RefusesDottedKeysSinceTheSchemaDoes) {
  EXPECT_THAT(problems_of(R"({"log.level": "info"})"), ElementsAre(HasSubstr("dotted key")));
  EXPECT_THAT(problems_of(R"({"log": {"level.x": "info"}})"), ElementsAre(HasSubstr("dotted key")));
}

TEST(ConfigFile, DeepNestingIsOneProblemAndTakesNoStack) {
  constexpr std::size_t kDepth = 100'000;
  std::string arrays = "{\"port\": " + std::string(kDepth, '[') + std::string(kDepth, ']') + "}";
  EXPECT_THAT(problems_of(arrays), ElementsAre(HasSubstr("port: found an array")));
  std::string objects = "{\"log\": ";
  for (int i = 0; i < 20'000; ++i) objects += "{\"a\":";
  EXPECT_THAT(problems_of(objects),
              ElementsAre(HasSubstr("log.a"), HasSubstr("expected JSON, comments allowed")));
}

TEST(ConfigFile, ManyMistakesAreCut) {
  std::string text = "{";
  for (int i = 0; i < 10'000; ++i) text += "\"k" + std::to_string(i) + "\": 1, ";
  EXPECT_THAT(problems_of(text + "\"port\": 1}"), SizeIs(51));
}

TEST(ConfigFile, TenMegabytesAreNotRead) {
  const test::TemporaryFolder folder;
  const auto file = folder.write("large.json", std::string(10'000'000, ' ') + "{}");
  EXPECT_THAT(texts(read_config(file).problems),
              ElementsAre(HasSubstr("found a larger file, expected at most")));
}

TEST(ConfigFile, FolderAndMissingFileAreProblems) {
  const test::TemporaryFolder folder;
  EXPECT_THAT(texts(read_config(folder.path()).problems), ElementsAre(HasSubstr("found a folder")));
  EXPECT_THAT(texts(read_config(folder.path() / "none").problems),
              ElementsAre(HasSubstr("found nothing to read, expected a file")));
}

TEST(ConfigFile, ForeignTextCannotForgeALine) {
  const std::vector<std::string> problems =
      problems_of("{\"a\\nstillmap: good\": 1, \"log\": {\"level\": \"x\\u001b[31m\\ny\"}}");
  ASSERT_THAT(problems, SizeIs(2));
  for (const std::string& each : problems) {
    EXPECT_EQ(each.find_first_of("\n\x1b"), std::string::npos) << each;
  }
}

TEST(ConfigFile, NearestKeyIsTheOneThatWasMeant) {
  EXPECT_EQ(nearest_key("prot"), "port");
  EXPECT_EQ(nearest_key("jobs.memory"), "jobs.memory_bytes");
  EXPECT_EQ(nearest_key("log.lvl"), "log.level");
  EXPECT_EQ(nearest_key(std::string(65, 'x')), "");
}

TEST_F(ConfigTest, ListingIsAConfigurationThatGivesTheSame) {
  ConfigSources sources = with_file(R"({"sessions": {"max": 7}, "gate": {"min_coverage": 0.125}})");
  sources.flags = {{"host", "localhost"}};
  const ResolvedConfig config = resolve(sources);
  ASSERT_THAT(texts(config.problems), IsEmpty());
  const std::string listing = config_listing(config);
  EXPECT_THAT(listing, HasSubstr("\"host\": \"localhost\",  // --host\n"));
  EXPECT_THAT(listing, HasSubstr("\"max\": 7,  // " + sources.file->string() + "\n"));
  EXPECT_THAT(listing, HasSubstr("\"port\": 8080,  // default\n"));
  const ResolvedConfig again = resolve(with_file(listing));
  EXPECT_THAT(texts(again.problems), IsEmpty());
  for (const Option& option : all_options()) {
    EXPECT_EQ(option.get(again.options), option.get(config.options)) << option.key;
  }
}

TEST_F(ConfigTest, ReloadPutsInForceWhatMayChangeAndNamesTheRest) {
  OptionsHolder holder(ServerOptions{});
  const auto before = holder.current();
  const ReloadResult result =
      reload(with_file(R"({"port": 1, "log": {"level": "debug"}})"), holder);
  EXPECT_THAT(result.problems, IsEmpty());
  EXPECT_THAT(result.changed, ElementsAre("log.level"));
  EXPECT_THAT(result.need_restart, ElementsAre("port"));
  EXPECT_EQ(holder.current()->log.level, "debug");
  EXPECT_EQ(holder.current()->port, ServerOptions{}.port);
  EXPECT_EQ(before->log.level, "info") << "who took the options before keeps them";
}

TEST_F(ConfigTest, BrokenFileLeavesWhatRuns) {
  OptionsHolder holder(ServerOptions{});
  const auto before = holder.current();
  for (const char* text : {"{", R"({"log": {"level": "debug", "format": "xml"}})"}) {
    const ReloadResult result = reload(with_file(text), holder);
    EXPECT_THAT(result.problems, SizeIs(1)) << text;
    EXPECT_THAT(result.changed, IsEmpty());
    EXPECT_EQ(holder.current(), before);
  }
}

TEST_F(ConfigTest, ReloadChangesAllOrNothing) {
  OptionsHolder holder(ServerOptions{});
  const auto before = holder.current();
  const ConfigSources sources = with_file(R"({"log": {"level": "debug"}})");
  std::vector<std::string> done;
  const auto step = [&](const std::string& name) {
    return [&done, name](const ServerOptions& next) {
      done.push_back("try " + name + " at " + next.log.level);
      return [&done, name] { done.push_back("do " + name); };
    };
  };
  const auto broken = [&](const ServerOptions&) -> PreparedReload {
    EXPECT_EQ(holder.current(), before);
    throw std::runtime_error("it cannot be opened");
  };
  EXPECT_THROW(static_cast<void>(reload(sources, holder, {step("a"), broken, step("b")})),
               std::runtime_error);
  EXPECT_EQ(holder.current(), before);
  EXPECT_THAT(done, ElementsAre("try a at debug"));
  done.clear();
  EXPECT_THAT(reload(sources, holder, {step("a"), step("b")}).changed, ElementsAre("log.level"));
  EXPECT_EQ(holder.current()->log.level, "debug");
  EXPECT_THAT(done, ElementsAre("try a at debug", "try b at debug", "do a", "do b"));
  done.clear();
  EXPECT_THAT(reload(with_file("{"), holder, {step("a")}).problems, SizeIs(1));
  EXPECT_THAT(done, IsEmpty());
}

TEST(OptionsHolder, RefusesBrokenOnes) {
  ServerOptions broken;
  broken.workers = -1;
  EXPECT_THROW(OptionsHolder{broken}, std::invalid_argument);
  OptionsHolder holder(ServerOptions{});
  EXPECT_THROW(holder.replace(broken), std::invalid_argument);
  EXPECT_EQ(holder.current()->workers, 0);
}

TEST(OwnEnvironment, HoldsOurVariablesAloneAndNotTheFilesName) {
  ::setenv("STILLMAP_SERVE_PORT", "9", 1);
  ::setenv("STILLMAP_SERVE_CONFIG", "/f", 1);
  ::setenv("STILLMAP_PORT", "tcp://10.0.0.1:8080", 1);
  // Those who run the tests may have set others, as the presets of CMake do.
  const auto held = own_environment();
  EXPECT_THAT(held, Contains(std::pair<std::string, std::string>("STILLMAP_SERVE_PORT", "9")));
  EXPECT_THAT(held, Not(Contains(Key("STILLMAP_SERVE_CONFIG"))));
  EXPECT_THAT(held, Each(Key(StartsWith("STILLMAP_SERVE_"))));
  for (const char* each : {"STILLMAP_SERVE_PORT", "STILLMAP_SERVE_CONFIG", "STILLMAP_PORT"}) {
    ::unsetenv(each);
  }
}

}  // namespace config_test
}  // namespace stillmap::server
