#pragma once

#include <stillmap/maps/error.hpp>
#include "blobs/http_transport.hpp"
#include "blobs/retry_policy.hpp"
#include "blobs/s3_credentials.hpp"

#include <chrono>
#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::server {

struct S3Options {
  /// `http://HOST:PORT` or `https://HOST`, without a path.
  std::string endpoint{};
  std::string bucket{};
  /// Before the key of every object; empty, or ends with a slash.
  std::string prefix{};
  std::string region = "us-east-1";
  /// `bucket.HOST/key` in place of `HOST/bucket/key`.
  bool virtual_hosted = false;
  /// Empty: from the environment.
  std::filesystem::path credentials_file{};
  HttpTransportOptions transport{};
  RetryPolicy retry{};
  /// A larger file is sent in parts of this size, at least 5 MiB.
  std::uint64_t part_bytes = std::uint64_t{64} << 20U;
  /// Objects of one page of a listing.
  int page_objects = 1000;
};

struct S3Range {
  std::uint64_t offset = 0;
  /// Nothing: to the end.
  std::optional<std::uint64_t> bytes{};
};

/// An answer of S3 that is an error, or no answer after all tries. The message names the object and
/// what to do, and holds no credentials.
class S3Error : public maps::StorageError {
 public:
  S3Error(const std::string& object, const std::string& reason, int status)
      : maps::StorageError(object, reason), status_(status) {}
  /// Of HTTP; 0 when there was no answer.
  [[nodiscard]] int status() const { return status_; }
  [[nodiscard]] bool is_missing() const { return status_ == 404; }
  /// Whether there was no answer, or one of a server that is overloaded or broken.
  [[nodiscard]] bool may_pass() const {
    return status_ == 0 || status_ == 429 || (status_ >= 500 && status_ <= 504 && status_ != 501);
  }

 private:
  int status_;
};

/// Objects in a bucket of S3 or of a server that speaks like it. Asks for no conditional writes,
/// which some of them do not have. What fails for a moment is tried again (`RetryPolicy`). Safe
/// from several threads. All members throw S3Error; maps::InputError for credentials that are
/// missing.
class S3Client {
 public:
  using Clock = std::function<std::chrono::system_clock::time_point()>;
  /// @param clock  by which requests are signed. @throws std::invalid_argument for options.
  explicit S3Client(const S3Options& options, Clock clock = &std::chrono::system_clock::now);

  /// "s3://BUCKET/PREFIX" and the key, for messages.
  [[nodiscard]] std::string name_of(const std::string& key) const;

  /// @param sha256  of the bytes, lower-case hex: a server that gets others refuses them.
  void put(const std::string& key, std::string_view bytes, const std::string& sha256);
  /// The same of a file, which is read while it is sent.
  /// @throws also StorageError when the file cannot be read, becomes shorter, or has other bytes.
  void put_file(const std::string& key, const std::filesystem::path& file,
                const std::string& sha256);

  /// Takes pieces of an object in order, each byte once. What it throws ends the request.
  using Sink = std::function<void(std::string_view)>;
  /// After a lost connection it goes on from the byte at which it was.
  void get(const std::string& key, const Sink& sink, const S3Range& range = {});
  /// An object of at most so many bytes.
  [[nodiscard]] std::string get_text(const std::string& key,
                                     std::uint64_t most_bytes = std::uint64_t{8} << 20U);

  /// Bytes of an object; nothing when there is none.
  [[nodiscard]] std::optional<std::uint64_t> size_of(const std::string& key);

  struct Listed {
    std::string key;
    std::uint64_t bytes = 0;
    /// Of its last change, such as 2026-11-30T12:00:00.000Z.
    std::string modified{};
  };
  /// All objects whose key begins so, sorted by key.
  /// @param begin  without the prefix of the options, as the keys that come.
  void list(const std::string& begin, const std::function<void(const Listed&)>& visit);

  /// One that is not there is removed already.
  void remove(const std::string& key);

  /// Makes the bucket; one that is there stays.
  void make_bucket();

  /// @throws maps::InputError when there are no credentials.
  void require_credentials() { (void)credentials_.current(); }
  struct Figures {
    /// Whether the newest try got no answer, or one that may pass, less than a minute ago.
    bool is_away = false;
    /// Tries that ended well or with a refusal, and those that did as above.
    std::uint64_t answered = 0, failed = 0;
  };
  [[nodiscard]] Figures figures() const;
  /// Ends requests that are under way, and lets none begin.
  void stop();

 private:
  struct Request;
  struct Answer;
  [[nodiscard]] HttpCall signed_call(const Request& request);
  /// One try. @return nothing of the body where it is taken by `Request::take`.
  [[nodiscard]] Answer try_once(const Request& request);
  /// Until it has an answer that is final, whatever it is.
  [[nodiscard]] Answer ask(const Request& request, const std::function<void(Request&)>& again = {});
  /// As `ask`. @throws S3Error unless the status is one of 2xx.
  Answer ask_well(const Request& request, const std::function<void(Request&)>& again = {});
  [[noreturn]] void refuse(const Request& request, const Answer& answer) const;
  void put_in_parts(const std::string& key, const std::filesystem::path& file, std::uint64_t bytes,
                    const std::string& sha256);
  void complete_parts(const std::string& key, const std::string& upload, const std::string& list,
                      std::uint64_t bytes);
  /// @return false when it is to end.
  bool sleep(std::chrono::milliseconds pause);

  S3Options options_;
  Clock clock_;
  S3CredentialsSource credentials_;
  HttpTransport transport_;
  /// "http://127.0.0.1:6600", and as the header `Host` says it.
  std::string base_, host_;
  mutable std::mutex mutex_;
  std::condition_variable stopping_;
  bool stopped_ = false;
  std::uint64_t answered_ = 0, failed_ = 0;
  /// Of the newest try, if it had no good answer.
  std::optional<std::chrono::steady_clock::time_point> failed_at_;
};

}  // namespace stillmap::server
