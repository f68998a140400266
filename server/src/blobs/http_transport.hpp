#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace stillmap::server {

struct HttpTransportOptions {
  /// Certificates (PEM) of authorities that are trusted; empty: those of the system.
  std::string ca_file{};
  /// Connections at one time; they are kept open.
  std::size_t connections = 8;
  std::chrono::milliseconds connect_timeout{5'000};
  /// A request that is slower than `least_bytes_per_s` for so long fails; full seconds.
  std::chrono::seconds stall_timeout{20};
  std::uint32_t least_bytes_per_s = 4096;
};

struct HttpCall {
  /// GET, HEAD, PUT, POST or DELETE.
  std::string method;
  std::string url;
  /// "name: value".
  std::vector<std::string> headers{};
  std::uint64_t body_bytes = 0;
  /// Fills the span with bytes of the body from an offset on. @return how many.
  std::function<std::size_t(std::uint64_t offset, std::span<char> into)> body{};
  /// Takes pieces of the answer's body. What it throws ends the call, and comes out of `perform`.
  std::function<void(int status, std::string_view piece)> take{};
};

struct HttpReply {
  /// 0 when there was no answer.
  int status = 0;
  /// Names in lower case.
  std::map<std::string, std::string> headers{};
  /// Why the answer is missing or not whole; empty when it is whole.
  std::string failure{};
  /// Whether what failed may pass at another time: a lost connection, not a wrong certificate.
  bool may_pass = false;
};

/// Sends requests by libcurl over a bounded number of connections that are kept open. No redirect
/// is followed and no proxy of the environment used; the server's certificate is always checked.
/// Safe from several threads: those beyond the bound wait.
class HttpTransport {
 public:
  /// @throws std::runtime_error when libcurl cannot start.
  explicit HttpTransport(const HttpTransportOptions& options);
  ~HttpTransport();
  HttpTransport(const HttpTransport&) = delete;
  HttpTransport& operator=(const HttpTransport&) = delete;

  [[nodiscard]] HttpReply perform(const HttpCall& call);
  /// Ends calls that are under way, and lets none begin.
  void stop();
  [[nodiscard]] bool is_stopped() const;

 private:
  struct Pool;
  HttpTransportOptions options_;
  std::unique_ptr<Pool> pool_;
  std::atomic<bool> stopped_ = false;
};

}  // namespace stillmap::server
