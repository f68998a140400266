#include "metrics/metrics.hpp"

#include <gmock/gmock.h>

#include <ctime>
#include <regex>
#include <set>
#include <string>

namespace stillmap::server {
namespace metrics_test {

using ::testing::HasSubstr;
using ::testing::Not;

std::set<std::string> names_in(const std::string& text) {
  std::set<std::string> names;
  const std::regex type("# TYPE (\\S+) ");
  for (auto i = std::sregex_iterator(text.begin(), text.end(), type); i != std::sregex_iterator();
       ++i) {
    names.insert((*i)[1]);
  }
  return names;
}

/// Calls everything once.
void use_all(Metrics& metrics) {
  metrics.request_begun();
  metrics.request_answered({.method = "GET", .route = "/livez", .status = 200, .seconds = 0.002});
  metrics.problem(ErrorCode::kBusy);
  metrics.connection_opened();
  metrics.connection_refused("full");
  metrics.event_stream_opened();
  metrics.aligned("town", "default", "ok", 0.03);
  metrics.queue_waited(0.1);
  metrics.scan_superseded();
  metrics.sealed_scan("begun");
  metrics.set_map_chosen("town", "prior");
  metrics.handed_over("town");
  metrics.hand_over_refused("town");
  metrics.set_workers(1, 0, 2);
  metrics.set_queue(3, 16);
  metrics.set_sessions(4);
  metrics.set_maps(1, 0, 0);
  metrics.map_loaded("town", 2.0);
  metrics.map_load_failed("depot");
  metrics.set_map_revisions({{"town", 3}});
  metrics.set_rollouts({{.map = "town", .share = 0.1, .halted = false}});
  metrics.rollout_answered("town", "others", "ok");
  metrics.set_jobs("enqueued", 1);
  metrics.job_ended("failed", 100.0);
  metrics.set_store_bytes(1000);
  metrics.set_store_disk(2000, 100, true);
  metrics.set_state_silence(0.1);
  metrics.audit_missed();
  metrics.set_blobs({.answered = 5, .failed = 1, .cache_bytes = 1000, .found = 3, .fetched = 2});
  metrics.set_certificate_end(2e9);
  metrics.reloaded(true);
}

TEST(Metrics, TableHoldsExactlyWhatIsSaid) {
  Metrics metrics("1.2.3");
  use_all(metrics);
  const std::string text = metrics.text();
  std::set<std::string> table;
  for (const MetricInfo& info : all_metrics()) {
    EXPECT_TRUE(table.emplace(info.name).second) << info.name;
    EXPECT_THAT(text, HasSubstr("# TYPE " + std::string(info.name) + " " + std::string(info.type)));
  }
  EXPECT_EQ(names_in(text), table);
}

TEST(Metrics, NamesFollowTheConvention) {
  for (const MetricInfo& info : all_metrics()) {
    EXPECT_TRUE(info.name.starts_with("stillmap_") || info.name.starts_with("process_"))
        << info.name;
    EXPECT_EQ(info.type == "counter", info.name.ends_with("_total")) << info.name;
    EXPECT_TRUE(info.help.ends_with(".")) << info.name;
    for (const char* unit : {"_ms", "_mib", "_percent"}) EXPECT_FALSE(info.name.ends_with(unit));
  }
}

TEST(Metrics, RequestsAreCountedByRouteAndStatus) {
  Metrics metrics("1");
  for (const int status : {200, 206, 404}) {
    metrics.request_begun();
    metrics.request_answered(
        {.method = "GET", .route = "/v1/maps/{map}", .status = status, .seconds = 0.002});
  }
  const std::string text = metrics.text();
  EXPECT_THAT(text,
              HasSubstr("stillmap_http_requests_total{method=\"GET\",route=\"/v1/maps/{map}\","
                        "status=\"2xx\"} 2"));
  EXPECT_THAT(text, HasSubstr("status=\"4xx\"} 1"));
  EXPECT_THAT(text, HasSubstr("duration_seconds_bucket{route=\"/v1/maps/{map}\",le=\"0.001\"} 0"));
  EXPECT_THAT(text, HasSubstr("duration_seconds_bucket{route=\"/v1/maps/{map}\",le=\"0.0025\"} 3"));
  EXPECT_THAT(text, HasSubstr("stillmap_http_requests_in_flight 0"));
}

TEST(Metrics, ClientsCannotMakeSeries) {
  Metrics metrics("1");
  metrics.request_begun();
  metrics.request_answered({.method = "EVIL", .route = "", .status = 405});
  const std::string text = metrics.text();
  EXPECT_THAT(text, Not(HasSubstr("EVIL")));
  EXPECT_THAT(text, HasSubstr("method=\"other\",route=\"none\",status=\"4xx\"} 1"));
  for (int i = 0; i < 300; ++i) metrics.aligned("map-" + std::to_string(i), "default", "ok", 0.01);
  metrics.aligned("map-7", "default", "ok", 0.01);
  const std::string capped = metrics.text();
  EXPECT_THAT(capped, HasSubstr("{map=\"map-199\""));
  EXPECT_THAT(capped, HasSubstr("{map=\"map-7\",method=\"default\",status=\"ok\"} 2"));
  EXPECT_THAT(capped, Not(HasSubstr("{map=\"map-200\"")));
  EXPECT_THAT(capped, HasSubstr("{map=\"other\",method=\"default\",status=\"ok\"} 100"));
}

TEST(Metrics, CountsThatAreKeptElsewhereOnlyGrow) {
  Metrics metrics("1");
  metrics.set_blobs({.answered = 5, .failed = 1, .cache_bytes = 1000, .found = 3, .fetched = 2});
  metrics.set_blobs({.answered = 7, .failed = 1, .cache_bytes = 500, .found = 3, .fetched = 4});
  const std::string text = metrics.text();
  EXPECT_THAT(text, HasSubstr("stillmap_s3_requests_total{result=\"answered\"} 7"));
  EXPECT_THAT(text, HasSubstr("stillmap_s3_requests_total{result=\"failed\"} 1"));
  EXPECT_THAT(text, HasSubstr("stillmap_blob_cache_files_total{result=\"fetched\"} 4"));
  EXPECT_THAT(text, HasSubstr("stillmap_blob_cache_bytes 500"));
}

TEST(Metrics, TheRevisionOfAMapThatIsGoneIsZero) {
  Metrics metrics("1");
  metrics.set_map_revisions({{"town", 3}, {"depot", 2}});
  EXPECT_THAT(metrics.text(), HasSubstr("stillmap_map_revision{map=\"town\"} 3"));
  metrics.set_map_revisions({{"depot", 4}});
  EXPECT_THAT(metrics.text(), HasSubstr("stillmap_map_revision{map=\"town\"} 0"));
  EXPECT_THAT(metrics.text(), HasSubstr("stillmap_map_revision{map=\"depot\"} 4"));
}

TEST(Metrics, ReadersRunBeforeEachText) {
  Metrics metrics("1");
  std::size_t open = 4;
  metrics.add_reader([&] { metrics.set_sessions(++open); });
  EXPECT_THAT(metrics.text(), HasSubstr("stillmap_sessions 5"));
  EXPECT_THAT(metrics.text(), HasSubstr("stillmap_sessions 6"));
}

TEST(Metrics, ProcessFiguresAreOfThisProcess) {
  const std::string text = Metrics("1").text();
  const auto value = [&](const std::string& name) {
    return std::stod(text.substr(text.find("\n" + name + " ") + name.size() + 2));
  };
  EXPECT_GT(value("process_resident_memory_bytes"), 1e6);
  EXPECT_LT(value("process_resident_memory_bytes"), 1e11);
  EXPECT_GE(value("process_threads"), 1.0);
  EXPECT_GE(value("process_open_fds"), 3.0);
  const auto now = static_cast<double>(std::time(nullptr));
  EXPECT_GT(value("process_start_time_seconds"), now - 3600.0);
  EXPECT_LE(value("process_start_time_seconds"), now + 2.0);
}

}  // namespace metrics_test
}  // namespace stillmap::server
