// Bytes on a connection, the byte 0x1e behind them on the next one: the server's own loop over a
// socket pair, on this thread, with a stub instead of an aligner. The client has sent everything
// and waits. `{id}` and `{key}` stand for the last ones that an answer gave out. What was granted
// is undone behind an input, so that none meets what those before have changed.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"
#include "http/http_server.hpp"
#include "pose_rules.hpp"
#include "service.hpp"
#include "support/stored_packages.hpp"

#include <stillmap/maps/layer_file.hpp>
#include <stillmap/maps/map_difference.hpp>
#include <stillmap/maps/map_levels.hpp>
#include "store/package_store.hpp"

#include <spdlog/spdlog.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <thread>

namespace {

using namespace stillmap;

constexpr char kNextConnection = 0x1e;
/// The rest of an input is left out: some grew to a thousand, and took most of the time.
constexpr int kMostConnections = 16;

class StubAligner final : public localization::Aligner {
 public:
  localization::AlignmentResult align(
      const maps::PointCloud&, const std::optional<localization::Prior>& prior) const override {
    localization::AlignmentResult result;
    if (!prior) return result;
    result.status = localization::PoseStatus::kOk;
    result.T_map_lidar = prior->T_map_lidar;
    result.covariance.setIdentity();
    return result;
  }
};

/// Notes whether a request may have changed what those after it meet.
class Watch final : public server::RequestHandler {
 public:
  explicit Watch(const server::Service& service) : service_(service) {}

  [[nodiscard]] server::Router::Match find(const server::HttpRequest& request) const override {
    return service_.find(request);
  }
  void admit(server::HttpRequest& request, const server::Router::Match& match) const override {
    service_.admit(request, match);
  }
  [[nodiscard]] server::HttpResponse handle(const server::HttpRequest& request,
                                            const server::Router::Match& match) const override {
    server::HttpResponse response = service_.handle(request, match);
    const server::Route& route = *match.route;
    const bool only_asks =
        route.method == "GET" || route.pattern.find("/localize") != std::string::npos;
    changed_ |= !only_asks && response.status < 300;
    return response;
  }
  [[nodiscard]] bool changed() const { return changed_; }

 private:
  const server::Service& service_;
  mutable bool changed_ = false;
};

/// A store as each server finds it, copied since that takes less than to make it: with one map,
/// `town`, of two versions in one frame, and what is else made of them behind an input.
const std::filesystem::path& stored_town() {
  static const std::filesystem::path made = [] {
    const std::filesystem::path folder = fuzz::folder().path() / "store";
    std::filesystem::create_directory(folder);
    server::PackageStore store(folder);
    std::shared_ptr<const maps::MapPackage> before;
    for (int i = 0; i < 2; ++i) {
      const std::string version = "v" + std::to_string(i);
      const std::filesystem::path package = fuzz::folder().path() / version;
      std::optional<maps::Registration> registration;
      if (before) registration = {.previous_digest = before->digest()};
      test::write_package(package, i, 3, registration);
      store.add("town", version, package);
      store.activate("town", version);
      const auto map = store.open("town", version);
      maps::MapLevels::make(*map);
      maps::write_layer(map->folder() / "layers" / "coverage.layer", map->digest(),
                        *maps::coverage_of(*map));
      if (before)
        maps::MapDifference::make(*map, *before,
                                  maps::MapDifference::usual_tolerance_m(*map, *before));
      before = map;
    }
    return folder;
  }();
  return made;
}

/// A map that is ready when this is made.
struct Served {
  Served() {
    spdlog::set_level(spdlog::level::off);
    copy_town();
    store = std::make_unique<server::PackageStore>(folder.path());
    service = std::make_unique<server::Service>(
        options, *store,
        [](const maps::MapPackage&, const localization::LocalizationOptions&) {
          return server::Aligners{{"default", std::make_shared<StubAligner>()}};
        },
        std::vector<server::WebAsset>{});
    server::HttpRequest ready;
    ready.method = "GET";
    ready.path = "/readyz";
    while (service->handle(ready).status != 200)
      std::this_thread::sleep_for(std::chrono::microseconds(50));
    watch = std::make_unique<Watch>(*service);
    http = std::make_unique<server::HttpServer>(server::main_endpoint(options), *watch, nullptr);
  }

  void copy_town() const {
    using std::filesystem::copy_options;
    std::error_code error;
    // Again where libFuzzer looked at its clock.
    do
      std::filesystem::copy(stored_town(), folder.path(),
                            copy_options::recursive | copy_options::overwrite_existing, error);
    while (error == std::errc::interrupted);
    fuzz::require(!error, "a store");
  }

  test::TemporaryFolder folder{test::memory_folder()};
  server::ServerOptions options = fuzz::small_options();
  std::unique_ptr<server::PackageStore> store;
  std::unique_ptr<server::Service> service;
  std::unique_ptr<Watch> watch;
  std::unique_ptr<server::HttpServer> http;
};

/// Names that the server gives out are drawn at random.
struct GivenOut {
  void read(std::string_view answers) {
    for (auto& [name, value] : values) {
      const std::string before = "\"" + name + "\":";
      const std::size_t at = answers.rfind(before);
      if (at == std::string_view::npos) continue;
      const std::string_view rest = answers.substr(at + before.size());
      const std::size_t begin = std::min(rest.find_first_not_of(" \""), rest.size());
      value = rest.substr(begin, rest.find_first_of("\",\n}", begin) - begin);
    }
  }
  [[nodiscard]] std::string put_into(std::string text) const {
    // A stream of events would not end.
    if (text.find("/events") != std::string::npos) return text;
    for (const auto& [name, value] : values) {
      const std::string place = "{" + name + "}";
      for (std::size_t at = 0; (at = text.find(place, at)) != std::string::npos; at += value.size())
        text.replace(at, place.size(), value);
    }
    return text;
  }

  std::map<std::string, std::string> values = {{"id", "none"}, {"key", "none"}};
};

std::string all_from(int socket) {
  std::string all;
  char buffer[4096];
  for (ssize_t got = 0; (got = ::read(socket, buffer, sizeof(buffer))) > 0;)
    all.append(buffer, static_cast<std::size_t>(got));
  return all;
}

std::string answers_to(std::string_view sent, server::HttpServer& http) {
  int ends[2];
  fuzz::require(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) == 0, "a socket pair");
  // What does not fit the socket's buffer is cut off, as by a client that goes away.
  static_cast<void>(::send(ends[0], sent.data(), sent.size(), MSG_DONTWAIT | MSG_NOSIGNAL));
  ::shutdown(ends[0], SHUT_WR);
  std::string answers;
  std::thread client([&] { answers = all_from(ends[0]); });
  http.serve(ends[1]);
  client.join();
  ::close(ends[0]);
  return answers;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static auto served = std::make_unique<Served>();
  std::string_view input = fuzz::text_of(data, size);
  GivenOut given_out;
  int connections = 0;
  // The first key is not made over HTTP.
  const bool with_key = input.find("{key}") != std::string_view::npos;
  if (with_key) given_out.values["key"] = served->store->keys().create("first", {15}, {}, 1).text;
  do {
    const std::string sent =
        given_out.put_into(std::string(fuzz::take_until(input, kNextConnection)));
    const std::string answers = answers_to(sent, *served->http);
    fuzz::require(answers.empty() || answers.starts_with("HTTP/1.1 "), "answers are HTTP");
    // Quotation marks of a client's own text come back escaped, and the contract only lists the
    // code.
    fuzz::require(answers.find("\"code\":\"InternalError\"") == std::string::npos,
                  "nothing is unforeseen");
    given_out.read(answers);
  } while (!input.empty() && ++connections < kMostConnections);
  if (with_key || served->watch->changed()) served = std::make_unique<Served>();
  return 0;
}
