#include "blobs/s3_credentials.hpp"

#include <stillmap/maps/error.hpp>

#include <fmt/format.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string_view>
#include <utility>

#include <stillmap/maps/text.hpp>

namespace stillmap::server {
namespace {

constexpr std::uintmax_t kMostCredentialBytes = 64U << 10U;

std::string variable_text(const char* name) {
  const char* value = std::getenv(name);
  return value == nullptr ? std::string() : std::string(value);
}

S3Credentials credentials_of_environment() {
  S3Credentials credentials{variable_text("AWS_ACCESS_KEY_ID"),
                            variable_text("AWS_SECRET_ACCESS_KEY"),
                            variable_text("AWS_SESSION_TOKEN")};
  if (credentials.access_key_id.empty() || credentials.secret_access_key.empty())
    throw maps::InputError(
        "AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY", "nothing",
        "the credentials of S3: set both, or name a file with s3.credentials_file");
  return credentials;
}

std::string_view without_blanks(std::string_view text) {
  const auto begin = text.find_first_not_of(" \t\r");
  if (begin == text.npos) return {};
  return text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1);
}

S3Credentials parse_credentials(const std::string& file, std::string_view text) {
  S3Credentials credentials;
  bool in_default = true;
  std::size_t number = 0;
  while (const auto line = maps::take_line(text)) {
    ++number;
    const std::string_view content = without_blanks(*line);
    if (content.empty() || content.front() == '#' || content.front() == ';') continue;
    if (content.front() == '[') {
      in_default = content == "[default]";
      continue;
    }
    if (!in_default) continue;
    const std::size_t equals = content.find('=');
    if (equals == content.npos)
      throw maps::InputError(fmt::format("{} line {}", file, number), "no `=`",
                             "a line such as aws_access_key_id = ...");
    const std::string_view name = without_blanks(content.substr(0, equals));
    const std::string value(without_blanks(content.substr(equals + 1)));
    if (name == "aws_access_key_id") credentials.access_key_id = value;
    if (name == "aws_secret_access_key") credentials.secret_access_key = value;
    if (name == "aws_session_token") credentials.session_token = value;
  }
  if (credentials.access_key_id.empty() || credentials.secret_access_key.empty())
    throw maps::InputError(file, "no credentials below [default]",
                           "lines aws_access_key_id = ... and aws_secret_access_key = ...");
  return credentials;
}

}  // namespace

S3CredentialsSource::S3CredentialsSource(std::filesystem::path file) : file_(std::move(file)) {}

S3Credentials S3CredentialsSource::current() {
  if (file_.empty()) return credentials_of_environment();
  struct stat found {};
  if (::stat(file_.c_str(), &found) != 0)
    throw maps::StorageError(file_.string(), std::strerror(errno));
  if ((found.st_mode & (S_IRWXG | S_IRWXO)) != 0)
    throw maps::InputError(file_.string(), fmt::format("mode {:04o}", found.st_mode & 07777U),
                           "a file that its owner alone may read: chmod 600");
  const std::string state =
      fmt::format("{} {} {} {} {} {}", found.st_dev, found.st_ino, found.st_size,
                  found.st_mtim.tv_sec, found.st_mtim.tv_nsec, found.st_ctim.tv_nsec);
  const std::scoped_lock lock(mutex_);
  if (state != read_as_) {
    credentials_ = parse_credentials(file_.string(), maps::read_text(file_, kMostCredentialBytes));
    read_as_ = state;
  }
  return credentials_;
}

}  // namespace stillmap::server
