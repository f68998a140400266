#include "jobs/job_log.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

namespace stillmap::server {
namespace {

constexpr std::size_t kLongestLine = 300;

std::string ascii_line(std::string_view line) {
  std::string text;
  for (const char byte : line.substr(0, kLongestLine))
    text += byte >= ' ' && byte != 0x7f ? byte : '?';
  return text;
}

}  // namespace

JobLog::JobLog(const std::filesystem::path& file)
    : file_(::open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0640)) {
  struct stat found {};
  if (file_.is_open() && ::fstat(file_.get(), &found) == 0)
    written_ = static_cast<std::uint64_t>(found.st_size);
}

JobLog::~JobLog() { close(); }

void JobLog::append(std::string_view text) {
  const std::uint64_t room = kMostBytes - std::min(kMostBytes, written_);
  const std::size_t now = static_cast<std::size_t>(std::min<std::uint64_t>(room, text.size()));
  write(text.substr(0, now));
  left_out_ += text.size() - now;
  end_.append(text);
  // In halves, so that not every line moves all of them.
  if (end_.size() > 2 * kEndBytes) end_.erase(0, end_.size() - kEndBytes);
}

std::string JobLog::last_line() const {
  std::string_view text = end_;
  while (!text.empty()) {
    const std::size_t begin = text.find_last_of("\r\n");
    const std::string_view line = begin == std::string_view::npos ? text : text.substr(begin + 1);
    if (line.find_first_not_of(" \t") != std::string_view::npos) return ascii_line(line);
    if (begin == std::string_view::npos) break;
    text = text.substr(0, begin);
  }
  return {};
}

void JobLog::close() {
  if (left_out_ > 0) {
    const std::size_t size =
        static_cast<std::size_t>(std::min<std::uint64_t>({left_out_, end_.size(), kEndBytes}));
    write(fmt::format("\n... {} bytes are left out here ...\n", left_out_ - size));
    write(std::string_view(end_).substr(end_.size() - size));
  }
  left_out_ = 0;
  file_.reset();
}

void JobLog::write(std::string_view text) {
  while (file_.is_open() && !text.empty()) {
    const ssize_t done = ::write(file_.get(), text.data(), text.size());
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) return;
    written_ += static_cast<std::uint64_t>(done);
    text.remove_prefix(static_cast<std::size_t>(done));
  }
}

}  // namespace stillmap::server
