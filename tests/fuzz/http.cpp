// Bytes on a connection: the server's own loop over a socket pair, on this thread, with a stub
// instead of an aligner. The client has sent everything and waits.
#include "fuzz_folder.hpp"
#include "fuzz_target.hpp"
#include "http/http_server.hpp"
#include "pose_rules.hpp"
#include "service.hpp"
#include "support/stored_packages.hpp"

#include <stillmap/maps/store/package_store.hpp>

#include <spdlog/spdlog.h>
#include <sys/socket.h>
#include <unistd.h>

#include <chrono>
#include <memory>
#include <thread>

namespace {

using namespace stillmap;

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

/// One map, `town`, ready when this is made.
struct Served {
  Served() {
    spdlog::set_level(spdlog::level::off);
    const std::filesystem::path folder = fuzz::folder().path() / "store";
    const std::filesystem::path built = fuzz::folder().path() / "town";
    std::filesystem::create_directory(folder);
    test::write_package(built, 1, 3);
    store = std::make_unique<maps::PackageStore>(folder);
    store->add("town", "v1", built);
    store->activate("town", "v1");
    service = std::make_unique<server::Service>(
        options, *store,
        [](const maps::MapPackage&) {
          return server::Aligners{{"default", std::make_shared<StubAligner>()}};
        },
        std::vector<server::WebAsset>{});
    server::HttpRequest ready;
    ready.method = "GET";
    ready.path = "/readyz";
    while (service->handle(ready).status != 200)
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    http = std::make_unique<server::HttpServer>(server::main_endpoint(options), *service, nullptr);
  }

  server::ServerOptions options = fuzz::small_options();
  std::unique_ptr<maps::PackageStore> store;
  std::unique_ptr<server::Service> service;
  std::unique_ptr<server::HttpServer> http;
};

std::string all_from(int socket) {
  std::string all;
  char buffer[4096];
  for (ssize_t got = 0; (got = ::read(socket, buffer, sizeof(buffer))) > 0;)
    all.append(buffer, static_cast<std::size_t>(got));
  return all;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const Served served;
  int ends[2];
  fuzz::require(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends) == 0, "a socket pair");
  // What does not fit the socket's buffer is cut off, as by a client that goes away.
  static_cast<void>(::send(ends[0], data, size, MSG_DONTWAIT | MSG_NOSIGNAL));
  ::shutdown(ends[0], SHUT_WR);
  std::string answer;
  std::thread client([&] { answer = all_from(ends[0]); });
  served.http->serve(ends[1]);
  client.join();
  ::close(ends[0]);
  fuzz::require(answer.empty() || answer.starts_with("HTTP/1.1 "), "answers are HTTP");
  // Quotation marks of a client's own text come back escaped, and the contract only lists the code.
  fuzz::require(answer.find("\"code\":\"InternalError\"") == std::string::npos,
                "nothing is unforeseen");
  return 0;
}
