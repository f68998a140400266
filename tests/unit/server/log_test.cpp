#include <gmock/gmock.h>
#include <spdlog/spdlog.h>

#include <cmath>
#include <fstream>
#include <functional>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <stillmap/maps/error.hpp>
#include <thread>

#include "log/access_log.hpp"
#include "log/log_context.hpp"
#include "log/log_line.hpp"
#include "log/log_output.hpp"
#include "support/temporary_folder.hpp"

namespace stillmap::server {
namespace log_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

constexpr auto kTime =
    std::chrono::system_clock::time_point(std::chrono::milliseconds(1'700'000'000'007));

/// What a client may send to break a line, a terminal or JSON.
const std::vector<std::string> kHostile = {"a\nb",
                                           "a\r\nb",
                                           "\"},{\"level\":\"error\"",
                                           "\x1b[31mred",
                                           std::string("a\0b", 3),
                                           "\x7f",
                                           "\xff\xfe",
                                           "\xc0\xaf",
                                           "\xed\xa0\x80",
                                           "\xe2\x80\xa8",
                                           "\xc2\x9b"
                                           "31m",
                                           "\xe2\x80\xae",
                                           "a\\nb",
                                           "a status=200",
                                           "",
                                           std::string(100'000, 'x')};

nlohmann::json parsed(const std::string& line) {
  EXPECT_EQ(line.find('\n'), line.size() - 1) << line;
  for (const char c : line.substr(0, line.size() - 1)) {
    EXPECT_TRUE(c >= 0x20 && c < 0x7f) << line;
  }
  return nlohmann::json::parse(line);
}

TEST(LogLine, JsonHasTimeLevelMessageAndContext) {
  const LogContext context{.request_id = "r1", .trace_id = "t", .span_id = "s", .key_id = "k"};
  const AccessRecord access{.method = "POST",
                            .route = "/v1/maps/{map}/localize",
                            .status = 200,
                            .bytes_in = 10,
                            .bytes_out = 20,
                            .milliseconds = 1.5};
  const LogEntry entry{
      .time = kTime, .level = "info", .message = "request", .context = &context, .access = &access};
  EXPECT_EQ(json_line(entry),
            R"({"time":"2023-11-14T22:13:20.007Z","level":"info","message":"request",)"
            R"("request_id":"r1","trace_id":"t","span_id":"s","key_id":"k","method":"POST",)"
            R"("route":"/v1/maps/{map}/localize","status":200,"bytes_in":10,"bytes_out":20,)"
            R"("ms":1.500})"
            "\n");
  EXPECT_EQ(text_line(entry),
            "2023-11-14T22:13:20.007Z info    request request_id=r1 trace_id=t span_id=s key_id=k "
            "method=POST route=/v1/maps/{map}/localize status=200 bytes_in=10 bytes_out=20 "
            "ms=1.500\n");
}

TEST(LogLine, NoTextForgesALineNorAField) {
  for (const std::string& text : kHostile) {
    const LogContext context{.request_id = text, .trace_id = {}, .span_id = {}, .key_id = text};
    const AccessRecord access{.method = text, .route = text};
    const LogEntry entry{
        .time = kTime, .level = "info", .message = text, .context = &context, .access = &access};
    const nlohmann::json json = parsed(json_line(entry));
    EXPECT_EQ(json["level"], "info");
    EXPECT_EQ(json["status"], 0);
    const std::string line = text_line(entry);
    EXPECT_EQ(line.find('\n'), line.size() - 1);
    EXPECT_EQ(line.find_first_of("\r\x1b\x7f\x80"), std::string::npos);
    EXPECT_EQ(line.find(" key_id=a status=200"), std::string::npos) << "a value ends at a space";
  }
}

TEST(LogLine, LongMessagesAreCut) {
  const std::string text(1'000'000, 'x');
  EXPECT_LT(json_line({.time = kTime, .level = "info", .message = text}).size(), 17'000U);
}

TEST(LogLine, NoNumberBreaksJson) {
  const AccessRecord access{.milliseconds = std::nan("")};
  EXPECT_TRUE(
      parsed(json_line({.time = kTime, .level = "info", .message = "", .access = &access}))["ms"]
          .is_null());
}

TEST(LogContext, ScopesNestAndAreOfTheirThread) {
  EXPECT_EQ(current_log_context(), nullptr);
  {
    LogScope outer({.request_id = "outer", .trace_id = {}, .span_id = {}, .key_id = {}});
    outer.context().key_id = "k";
    EXPECT_EQ(current_log_context()->key_id, "k");
    {
      const LogScope inner({.request_id = "inner", .trace_id = {}, .span_id = {}, .key_id = {}});
      EXPECT_EQ(current_log_context()->request_id, "inner");
      std::thread([] { EXPECT_EQ(current_log_context(), nullptr); }).join();
    }
    EXPECT_EQ(current_log_context()->request_id, "outer");
  }
  EXPECT_EQ(current_log_context(), nullptr);
}

class LogOutputTest : public ::testing::Test {
 protected:
  LogOutputTest() : before_(spdlog::default_logger()), level_(spdlog::get_level()) {}
  ~LogOutputTest() override {
    spdlog::set_default_logger(before_);
    spdlog::set_level(level_);
  }

  [[nodiscard]] LogOptions options(const std::string& level = "info") const {
    return {.level = level, .format = "json", .file = (folder_.path() / "log").string()};
  }
  [[nodiscard]] std::vector<nlohmann::json> lines(const std::string& name = "log") const {
    std::vector<nlohmann::json> result;
    std::ifstream file(folder_.path() / name);
    for (std::string line; std::getline(file, line);) result.push_back(parsed(line + "\n"));
    return result;
  }

  test::TemporaryFolder folder_;

 private:
  std::shared_ptr<spdlog::logger> before_;
  spdlog::level::level_enum level_;
};

TEST_F(LogOutputTest, WritesWhatSpdlogGetsWithTheContextOfItsThread) {
  const LogOutput output(options());
  {
    const LogScope scope({.request_id = "r", .trace_id = {}, .span_id = {}, .key_id = {}});
    spdlog::warn("found {}", "x\ny");
  }
  spdlog::debug("left out");
  spdlog::critical("worst");
  const std::vector<nlohmann::json> written = lines();
  ASSERT_THAT(written, SizeIs(2));
  EXPECT_EQ(written[0]["message"], "found x\ny");
  EXPECT_EQ(written[0]["level"], "warning");
  EXPECT_EQ(written[0]["request_id"], "r");
  EXPECT_EQ(written[1]["level"], "error");
  EXPECT_FALSE(written[1].contains("request_id"));
}

TEST_F(LogOutputTest, ReopenFollowsARotationAndTakesOtherOptions) {
  LogOutput output(options());
  spdlog::info("first");
  std::filesystem::rename(folder_.path() / "log", folder_.path() / "log.1");
  spdlog::info("still the old file");
  output.reopen(options("debug"));
  spdlog::debug("second");
  EXPECT_THAT(lines("log.1"), SizeIs(2));
  ASSERT_THAT(lines(), SizeIs(1));
  EXPECT_EQ(lines()[0]["message"], "second");
}

TEST_F(LogOutputTest, WhatIsPreparedChangesNothingYet) {
  LogOutput output(options());
  LogOptions other = options("debug");
  other.file = (folder_.path() / "other").string();
  const std::function<void()> put_in_force = output.prepare(other);
  spdlog::debug("not said");
  spdlog::info("first");
  EXPECT_THAT(lines(), SizeIs(1));
  EXPECT_THAT(lines("other"), IsEmpty());
  put_in_force();
  spdlog::debug("second");
  EXPECT_THAT(lines(), SizeIs(1));
  EXPECT_THAT(lines("other"), SizeIs(1));
}

TEST_F(LogOutputTest, WhatCannotBeOpenedLeavesWhatRuns) {
  LogOutput output(options());
  LogOptions broken = options();
  broken.file = folder_.path().string();
  EXPECT_THROW(output.reopen(broken), maps::StorageError);
  broken = options();
  broken.format = "xml";
  EXPECT_THROW(output.reopen(broken), std::invalid_argument);
  broken = options("loud");
  EXPECT_THROW(output.reopen(broken), std::invalid_argument);
  spdlog::info("still here");
  EXPECT_THAT(lines(), SizeIs(1));
}

TEST_F(LogOutputTest, AFullDiskIsCountedAndSaidOnceThereIsRoom) {
  LogOptions full = options();
  full.file = "/dev/full";
  LogOutput output(full);
  spdlog::info("lost");
  spdlog::info("lost too");
  output.reopen(options());
  spdlog::info("kept");
  const std::vector<nlohmann::json> written = lines();
  ASSERT_THAT(written, SizeIs(2));
  EXPECT_EQ(written[0]["message"], "2 lines of this log could not be written");
  EXPECT_EQ(written[1]["message"], "kept");
}

TEST_F(LogOutputTest, LinesOfManyThreadsStayWhole) {
  const LogOutput output(options());
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([] {
      for (int n = 0; n < 200; ++n) spdlog::info("{}", std::string(300, 'x'));
    });
  }
  for (std::thread& each : threads) each.join();
  EXPECT_THAT(lines(), SizeIs(800));
}

TEST_F(LogOutputTest, RequestsAreLoggedByTheirRouteAndProbesAtDebug) {
  const LogOutput output(options());
  log_access({.method = "GET", .route = "/livez", .status = 200});
  log_access({.method = "GET", .route = "/v1/maps", .status = 200});
  set_request_lines(false);
  log_access({.method = "GET", .route = "/v1/maps", .status = 404});
  log_access({.method = "GET", .route = "/v1/maps", .status = 500});
  set_request_lines(true);
  const std::vector<nlohmann::json> written = lines();
  ASSERT_THAT(written, SizeIs(2));
  EXPECT_EQ(written[0]["route"], "/v1/maps");
  EXPECT_EQ(written[0]["level"], "info");
  EXPECT_EQ(written[1]["status"], 500);
  EXPECT_EQ(written[1]["level"], "warning");
  spdlog::info("no request");
  EXPECT_FALSE(lines().back().contains("status"));
}

}  // namespace log_test
}  // namespace stillmap::server
