#pragma once

#include "http/bounded_socket.hpp"
#include "http/http_message.hpp"
#include "http/request_head.hpp"
#include "http/router.hpp"

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace stillmap::server {

/// A body straight from the connection.
class SocketBody final : public BodyStream {
 public:
  SocketBody(BoundedSocket& socket, std::uint64_t size)
      : socket_(socket), size_(size), left_(size) {}

  [[nodiscard]] std::uint64_t size() const override { return size_; }
  [[nodiscard]] bool is_read() const { return left_ == 0; }
  [[nodiscard]] std::uint64_t left() const { return left_; }
  std::size_t read(std::span<char> to) override;

 private:
  BoundedSocket& socket_;
  std::uint64_t size_;
  std::uint64_t left_;
};

/// @return length of the body in bytes, as it travels; nothing when it is not said.
/// @throws ApiError for a length that is none.
[[nodiscard]] std::optional<std::uint64_t> announced_length(const RequestHead& head);

/// Largest bodies that are held as a whole, unpacked.
struct WholeBodyLimits {
  std::size_t bytes = 0;
  /// Of JSON.
  std::size_t json_bytes = 0;
};

/// What a route takes at most of a body that is held as a whole, unpacked.
[[nodiscard]] std::size_t most_whole_bytes(const RequestHead& head, const Route& route,
                                           const WholeBodyLimits& limits);

/// @throws ApiError when a route takes no body of this length or encoding.
void check_body(const RequestHead& head, std::optional<std::uint64_t> length, const Route& route,
                const WholeBodyLimits& limits);

/// Memory of bodies that were answered, for the next ones: fresh memory costs a page fault each 4
/// kB. Keeps at most 8 of up to 4 MiB. Safe from several threads.
class SpareBodies {
 public:
  /// @param bytes  of the next body: a small one gets no memory. @return what an earlier body was,
  /// to be overwritten, or empty.
  [[nodiscard]] std::string take(std::uint64_t bytes);
  void give(std::string&& body);

 private:
  std::mutex mutex_;
  std::vector<std::string> spare_;
};

/// Reads all of a body, and unpacks it when it comes in gzip.
/// @param room  memory to use, whatever it holds.
/// @throws ApiError when it is larger than `most` once unpacked, ends early or cannot be unpacked.
[[nodiscard]] std::string read_whole(SocketBody& body, const RequestHead& head, std::size_t most,
                                     std::string&& room = {});

}  // namespace stillmap::server
