#pragma once

#include "http/http_message.hpp"

#include <algorithm>
#include <string>
#include <utility>

namespace stillmap::server {

/// A streamed body that has come already.
class BodyInMemory final : public BodyStream {
 public:
  explicit BodyInMemory(std::string bytes) : bytes_(std::move(bytes)) {}
  [[nodiscard]] std::uint64_t size() const override { return bytes_.size(); }
  std::size_t read(std::span<char> to) override {
    const std::size_t count = std::min(to.size(), bytes_.size() - at_);
    std::copy_n(bytes_.data() + at_, count, to.data());
    at_ += count;
    return count;
  }

 private:
  std::string bytes_;
  std::size_t at_ = 0;
};

}  // namespace stillmap::server
