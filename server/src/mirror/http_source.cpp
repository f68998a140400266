#include "mirror/mirror_source.hpp"

#include <fmt/format.h>

#include <httplib.h>
#undef _res  // A macro of <resolv.h>, and a name in Eigen.

#include <chrono>
#include <nlohmann/json.hpp>
#include <utility>

namespace stillmap::server {
namespace {

constexpr std::chrono::seconds kTimeout{30};
/// Of an answer that is read whole: a problem, or what is known of a map.
constexpr std::size_t kMostAnswer = std::size_t{1} << 20U;

class HttpSource final : public MirrorSource {
 public:
  HttpSource(std::string url, const std::string& key, std::string vehicle)
      : url_(std::move(url)), vehicle_(std::move(vehicle)), client_(url_) {
    if (!client_.is_valid())
      throw std::invalid_argument("URL: '" + url_ + "', expected such as http://HOST:8080");
    if (!key.empty()) client_.set_bearer_token_auth(key);
    client_.set_connection_timeout(kTimeout);
    client_.set_read_timeout(kTimeout);
    client_.set_keep_alive(true);
  }

  Active active(const std::string& map) override {
    std::string path = "/v1/maps/" + map;
    if (!vehicle_.empty()) path = httplib::append_query_params(path, {{"vehicle", vehicle_}});
    const std::string body = whole(path);
    const auto json = nlohmann::json::parse(body, nullptr, false);
    const auto text = [&](const char* name) {
      const auto found = json.is_object() ? json.find(name) : json.end();
      return json.is_object() && found != json.end() && found->is_string()
                 ? found->get<std::string>()
                 : std::string();
    };
    Active active{text("version"), text("digest")};
    if (active.version.empty() || active.digest.empty())
      throw MirrorSourceError(url_ + path + ": no version that is served; activate one there");
    return active;
  }

  std::vector<MapSignature> signatures(const std::string& map,
                                       const std::string& version) override {
    const std::string path = fmt::format("/v1/maps/{}/versions/{}/signatures", map, version);
    return parse_signatures(whole(path), url_ + path);
  }

  void read(const File& file, std::uint64_t offset, const Take& take) override {
    const std::string path =
        fmt::format("/v1/maps/{}/versions/{}/files/{}", file.map, file.version, file.sha256);
    httplib::Headers headers;
    if (offset > 0) headers.emplace("Range", fmt::format("bytes={}-", offset));
    ask(path, headers, take, offset > 0 ? 206 : 200);
  }

 private:
  std::string whole(const std::string& path) {
    std::string body;
    ask(path, {}, [&](std::string_view piece) {
      body += piece;
      return body.size() <= kMostAnswer;
    });
    return body;
  }
  void ask(const std::string& path, const httplib::Headers& headers, const Take& take,
           int expected = 200) {
    int status = 0;
    std::string problem;
    bool stopped = false;
    const auto result = client_.Get(
        path, headers,
        [&](const httplib::Response& response) {
          status = response.status;
          return true;
        },
        [&](const char* bytes, std::size_t size) {
          if (status == expected) {
            stopped = !take({bytes, size});
            return !stopped;
          }
          problem.append(bytes, size);
          return problem.size() <= kMostAnswer;
        });
    if (stopped) return;
    if (status != 0 && status != expected)
      throw MirrorSourceError(fmt::format("{}{}: {}", url_, path, words_of(status, problem)));
    if (!result)
      throw MirrorSourceError(fmt::format("{}{}: {}; run the same command again to go on", url_,
                                          path, httplib::to_string(result.error())));
  }
  static std::string words_of(int status, const std::string& problem) {
    const auto json = nlohmann::json::parse(problem, nullptr, false);
    const std::string detail =
        json.is_object() && json.contains("detail") && json["detail"].is_string()
            ? json["detail"].get<std::string>()
            : std::string("no reason was given");
    return fmt::format("status {}, {}", status, detail);
  }

  std::string url_, vehicle_;
  httplib::Client client_;
};

}  // namespace

std::unique_ptr<MirrorSource> http_source(const std::string& url, const std::string& key,
                                          const std::string& vehicle) {
  return std::make_unique<HttpSource>(url, key, vehicle);
}

}  // namespace stillmap::server
