#include "blobs/s3_client.hpp"

#include <fcntl.h>
#include <fmt/chrono.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <ctime>
#include <memory>
#include <random>
#include <stdexcept>
#include <utility>
#include <vector>

#include <stillmap/maps/map_package.hpp>
#include <stillmap/maps/sha256.hpp>
#include <stillmap/maps/text.hpp>
#include "blobs/s3_xml.hpp"

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;
using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr std::string_view kEmptySha256 =
    "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
/// Of an answer that is read whole: an error, or a page of a listing.
constexpr std::size_t kMostAnswerBytes = std::size_t{8} << 20U;
constexpr std::uint64_t kLeastPartBytes = std::uint64_t{5} << 20U;
constexpr std::uint64_t kMostParts = 10'000;
/// S3 refuses requests whose time is further off.
constexpr seconds kMostSkew{900};
/// A server that asks for more patience than this is not waited for.
constexpr seconds kMostWished{30};

struct Endpoint {
  std::string scheme, host;
};

/// @return scheme, and host with the port unless it is the scheme's own.
Endpoint parse_endpoint(const std::string& text) {
  if (text.find('@') != text.npos)
    throw std::invalid_argument(
        "s3.endpoint: an address with credentials; they belong into the environment or "
        "s3.credentials_file");
  Endpoint endpoint;
  std::string_view usual_port;
  for (const auto& [scheme, port] : {std::pair("http://", ":80"), std::pair("https://", ":443")}) {
    if (!text.starts_with(scheme)) continue;
    endpoint.scheme = scheme;
    endpoint.host = text.substr(endpoint.scheme.size());
    usual_port = port;
  }
  if (endpoint.host.ends_with('/')) endpoint.host.pop_back();
  constexpr std::string_view kOfHosts =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789.-_:[]";
  if (endpoint.host.empty() || endpoint.host.find_first_not_of(kOfHosts) != endpoint.host.npos)
    throw std::invalid_argument(
        "s3.endpoint: '" + text +
        "', expected an address without a path, such as https://HOST or http://127.0.0.1:9000");
  if (endpoint.host.ends_with(usual_port))
    endpoint.host.resize(endpoint.host.size() - usual_port.size());
  return endpoint;
}

/// A header `Date`: Sun, 06 Nov 1994 08:49:37 GMT.
std::optional<std::chrono::system_clock::time_point> parse_date(const HttpReply& reply) {
  const auto header = reply.headers.find("date");
  if (header == reply.headers.end()) return std::nullopt;
  std::tm parts{};
  if (::strptime(header->second.c_str(), "%a, %d %b %Y %H:%M:%S GMT", &parts) == nullptr)
    return std::nullopt;
  return std::chrono::system_clock::from_time_t(::timegm(&parts));
}

bool is_bucket_name(std::string_view name) {
  const bool plain =
      name.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789.-_") ==
      name.npos;
  return plain && name.size() >= 3 && name.size() <= 63 && name.front() != '.';
}

/// In [0, 1).
double random_share() {
  thread_local std::minstd_rand engine{std::random_device{}()};
  return std::uniform_real_distribution<double>(0.0, 1.0)(engine);
}

/// A file that is sent.
class OpenFile {
 public:
  explicit OpenFile(const fs::path& file)
      : file_(file), descriptor_(::open(file.c_str(), O_RDONLY | O_CLOEXEC)) {
    struct stat found {};
    if (descriptor_ < 0 || ::fstat(descriptor_, &found) != 0) {
      const int reason = errno;
      if (descriptor_ >= 0) ::close(descriptor_);
      throw maps::StorageError(file.string(), std::strerror(reason));
    }
    bytes_ = static_cast<std::uint64_t>(found.st_size);
  }
  ~OpenFile() { ::close(descriptor_); }
  OpenFile(const OpenFile&) = delete;
  OpenFile& operator=(const OpenFile&) = delete;

  [[nodiscard]] std::uint64_t bytes() const { return bytes_; }
  [[nodiscard]] std::size_t read(std::uint64_t offset, std::span<char> into) const {
    while (true) {
      const ssize_t got =
          ::pread(descriptor_, into.data(), into.size(), static_cast<off_t>(offset));
      if (got > 0) return static_cast<std::size_t>(got);
      if (got == 0) throw maps::StorageError(file_.string(), "became shorter while it was sent");
      if (errno != EINTR) throw maps::StorageError(file_.string(), std::strerror(errno));
    }
  }
  /// Of a part. @param whole  takes the same bytes.
  [[nodiscard]] std::string sha256(std::uint64_t offset, std::uint64_t bytes,
                                   maps::Sha256& whole) const {
    maps::Sha256 hash;
    std::vector<char> buffer(std::size_t{256} << 10U);
    for (std::uint64_t done = 0; done < bytes;) {
      const std::size_t most = std::min<std::uint64_t>(buffer.size(), bytes - done);
      const std::size_t got = read(offset + done, std::span(buffer).first(most));
      hash.add(buffer.data(), got);
      whole.add(buffer.data(), got);
      done += got;
    }
    return hash.hex();
  }

 private:
  fs::path file_;
  int descriptor_;
  std::uint64_t bytes_ = 0;
};

/// What the server says that the operator can do something about.
std::string advice_for(const std::string& code, int status) {
  if (code == "InvalidAccessKeyId" || code == "SignatureDoesNotMatch" || code == "InvalidToken" ||
      code == "ExpiredToken" || status == 401)
    return ": check the access key, its secret and s3.region";
  if (code == "NoSuchBucket") return ": make the bucket, or name another one with --blobs";
  if (code == "AuthorizationHeaderMalformed" || code == "PermanentRedirect" || status == 301 ||
      status == 307)
    return ": the bucket is in another region: set s3.region and s3.endpoint to it";
  if (code == "XAmzContentSHA256Mismatch" || code == "BadDigest")
    return ": the file is damaged or was changed on its way: read the disk again";
  if (status == 403) return ": the access key may not do this: check the bucket's policy";
  if (status == 507 || code == "QuotaExceeded") return ": the storage is full: make room there";
  return {};
}

bool is_transient(int status, const std::string& code) {
  if (code == "RequestTimeout" || code == "SlowDown") return true;
  return status == 429 || status == 500 || status == 502 || status == 503 || status == 504;
}

}  // namespace

struct S3Client::Request {
  std::string method;
  /// Empty for the bucket itself.
  std::string key;
  std::map<std::string, std::string> query{};
  std::map<std::string, std::string> headers{};
  std::string body_sha256{kEmptySha256};
  std::uint64_t body_bytes = 0;
  std::function<std::size_t(std::uint64_t, std::span<char>)> body{};
  /// Takes the body of an answer of 200 or 206; otherwise, and without it, it is in the answer.
  std::function<void(int status, std::string_view)> take{};
};

struct S3Client::Answer {
  HttpReply reply{};
  std::string body{};
  /// Of an error, such as NoSuchKey.
  std::string code{};
  [[nodiscard]] bool is_well() const {
    return reply.failure.empty() && reply.status >= 200 && reply.status < 300;
  }
};

S3Client::S3Client(const S3Options& options, Clock clock)
    : options_(options),
      clock_(std::move(clock)),
      credentials_(options.credentials_file),
      transport_(options.transport) {
  if (!is_bucket_name(options_.bucket))
    throw std::invalid_argument("bucket: '" + options_.bucket +
                                "', expected 3 to 63 letters, digits, '.', '-' and '_'");
  if (!options_.prefix.empty() && !options_.prefix.ends_with('/')) options_.prefix += '/';
  if (options_.part_bytes < kLeastPartBytes)
    throw std::invalid_argument("part_bytes: below 5 MiB, which S3 refuses");
  const Endpoint endpoint = parse_endpoint(options_.endpoint);
  host_ = options_.virtual_hosted ? options_.bucket + "." + endpoint.host : endpoint.host;
  base_ = endpoint.scheme + host_;
}

std::string S3Client::name_of(const std::string& key) const {
  return "s3://" + options_.bucket + "/" + options_.prefix + key;
}

S3Client::Figures S3Client::figures() const {
  constexpr std::chrono::minutes kCounts{1};
  const std::scoped_lock lock(mutex_);
  return {.is_away = failed_at_ && std::chrono::steady_clock::now() - *failed_at_ <= kCounts,
          .answered = answered_,
          .failed = failed_};
}

void S3Client::stop() {
  {
    const std::scoped_lock lock(mutex_);
    stopped_ = true;
  }
  transport_.stop();
  stopping_.notify_all();
}

bool S3Client::sleep(milliseconds pause) {
  std::unique_lock lock(mutex_);
  return !stopping_.wait_for(lock, pause, [&] { return stopped_; });
}

HttpCall S3Client::signed_call(const Request& request) {
  const S3Credentials credentials = credentials_.current();
  std::string path = options_.virtual_hosted ? "/" : "/" + options_.bucket;
  if (!request.key.empty()) {
    if (!path.ends_with('/')) path += '/';
    path += options_.prefix + request.key;
  }
  RequestToSign signing{.method = request.method,
                        .path = percent_encoded(path, /*is_path=*/true),
                        .query = request.query,
                        .headers = request.headers,
                        .body_sha256 = request.body_sha256};
  signing.headers["host"] = host_;
  signing.headers["x-amz-content-sha256"] = request.body_sha256;
  signing.headers["x-amz-date"] =
      fmt::format("{:%Y%m%dT%H%M%SZ}", std::chrono::floor<seconds>(clock_()));
  if (!credentials.session_token.empty())
    signing.headers["x-amz-security-token"] = credentials.session_token;

  HttpCall call{.method = request.method, .url = base_ + signing.path};
  if (!request.query.empty()) call.url += "?" + canonical_query(request.query);
  for (const auto& [name, value] : signing.headers)
    call.headers.push_back(fmt::format("{}: {}", name, value));
  call.headers.push_back("authorization: " +
                         authorization_v4(signing, {.region = options_.region}, credentials));
  call.body_bytes = request.body_bytes;
  call.body = request.body;
  return call;
}

S3Client::Answer S3Client::try_once(const Request& request) {
  HttpCall call = signed_call(request);
  Answer answer;
  call.take = [&](int status, std::string_view piece) {
    if (request.take && (status == 200 || status == 206)) return request.take(status, piece);
    if (answer.body.size() + piece.size() > kMostAnswerBytes)
      throw S3Error(name_of(request.key), "an answer of more than 8 MiB: is this an S3 server?",
                    status);
    answer.body += piece;
  };
  answer.reply = transport_.perform(call);
  const bool is_error =
      answer.reply.status >= 300 || answer.body.find("<Error>") != std::string::npos;
  if (is_error) answer.code = maps::one_line(xml_text(answer.body, "Code").value_or(""));
  return answer;
}

S3Client::Answer S3Client::ask(const Request& request, const std::function<void(Request&)>& again) {
  Request now = request;
  const auto begin = std::chrono::steady_clock::now();
  for (int tries = 1;; ++tries) {
    Answer answer = try_once(now);
    const bool lost = !answer.reply.failure.empty();
    const bool passes =
        lost ? answer.reply.may_pass : is_transient(answer.reply.status, answer.code);
    {
      const std::scoped_lock lock(mutex_);
      failed_at_.reset();
      if (passes) failed_at_ = std::chrono::steady_clock::now();
      ++(passes ? failed_ : answered_);
    }
    if (!passes) return answer;
    milliseconds wished{0};
    const auto header = answer.reply.headers.find("retry-after");
    if (header != answer.reply.headers.end())
      if (const auto count = maps::parse_count(header->second))
        wished =
            std::min<milliseconds>(seconds(std::min<std::uint64_t>(*count, 3600)), kMostWished);
    const auto spent =
        std::chrono::duration_cast<milliseconds>(std::chrono::steady_clock::now() - begin);
    const auto pause = options_.retry.pause(tries, spent, random_share(), wished);
    if (!pause || !sleep(*pause)) return answer;
    if (again) again(now);
  }
}

S3Client::Answer S3Client::ask_well(const Request& request,
                                    const std::function<void(Request&)>& again) {
  Answer answer = ask(request, again);
  if (!answer.is_well()) refuse(request, answer);
  return answer;
}

void S3Client::refuse(const Request& request, const Answer& answer) const {
  const std::string object = name_of(request.key);
  const HttpReply& reply = answer.reply;
  if (!reply.failure.empty())
    throw S3Error(object, fmt::format("{} at {}: {}", request.method, base_, reply.failure), 0);
  std::string reason = fmt::format("{} at {}: {} {}", request.method, base_, reply.status,
                                   answer.code.empty() ? "without a reason" : answer.code);
  const auto theirs = parse_date(reply);
  const seconds skew =
      theirs ? std::chrono::duration_cast<seconds>(clock_() - *theirs) : seconds(0);
  if (reply.status == 403 &&
      (answer.code == "RequestTimeTooSkewed" || std::chrono::abs(skew) > kMostSkew))
    reason += fmt::format(
        ": the clock of this machine is {} s {} that of the server: set it, such "
        "as by NTP",
        std::chrono::abs(skew).count(), skew.count() < 0 ? "behind" : "before");
  else
    reason += advice_for(answer.code, reply.status);
  throw S3Error(object, reason, reply.status);
}

void S3Client::put(const std::string& key, std::string_view bytes, const std::string& sha256) {
  const auto body = [bytes](std::uint64_t offset, std::span<char> into) {
    const std::string_view piece = bytes.substr(offset, into.size());
    std::ranges::copy(piece, into.begin());
    return piece.size();
  };
  ask_well({.method = "PUT",
            .key = key,
            .body_sha256 = sha256,
            .body_bytes = bytes.size(),
            .body = body});
}

void S3Client::put_file(const std::string& key, const fs::path& file, const std::string& sha256) {
  const OpenFile source(file);
  if (source.bytes() > options_.part_bytes) return put_in_parts(key, file, source.bytes(), sha256);
  const auto body = [&source](std::uint64_t offset, std::span<char> into) {
    return source.read(offset, into);
  };
  ask_well({.method = "PUT",
            .key = key,
            .body_sha256 = sha256,
            .body_bytes = source.bytes(),
            .body = body});
}

void S3Client::put_in_parts(const std::string& key, const fs::path& file, std::uint64_t bytes,
                            const std::string& sha256) {
  const OpenFile source(file);
  const std::uint64_t part_bytes = std::max(options_.part_bytes, bytes / kMostParts + 1);
  const Answer begun = ask_well({.method = "POST", .key = key, .query = {{"uploads", ""}}});
  const std::string upload = xml_text(begun.body, "UploadId").value_or("");
  if (upload.empty()) throw S3Error(name_of(key), "no UploadId: is this an S3 server?", 200);
  try {
    maps::Sha256 whole;
    std::string list = "<CompleteMultipartUpload>";
    int number = 1;
    for (std::uint64_t offset = 0; offset < bytes; offset += part_bytes, ++number) {
      const std::uint64_t size = std::min(part_bytes, bytes - offset);
      const auto body = [&source, offset](std::uint64_t at, std::span<char> into) {
        return source.read(offset + at, into);
      };
      const Answer sent =
          ask_well({.method = "PUT",
                    .key = key,
                    .query = {{"partNumber", std::to_string(number)}, {"uploadId", upload}},
                    .body_sha256 = source.sha256(offset, size, whole),
                    .body_bytes = size,
                    .body = body});
      const auto tag = sent.reply.headers.find("etag");
      if (tag == sent.reply.headers.end())
        throw S3Error(name_of(key), "a part without an ETag: is this an S3 server?", 200);
      list += fmt::format("<Part><PartNumber>{}</PartNumber><ETag>{}</ETag></Part>", number,
                          xml_escaped(tag->second));
    }
    // The server compares each part with its sum, and nobody the whole.
    if (const std::string found = whole.hex(); found != sha256)
      throw maps::StorageError(file.string(), "SHA-256 " + found + ", not " + sha256 +
                                                  ": the file is damaged or was changed while it "
                                                  "was sent: read the disk again");
    complete_parts(key, upload, list + "</CompleteMultipartUpload>", bytes);
  } catch (...) {
    try {
      (void)try_once({.method = "DELETE", .key = key, .query = {{"uploadId", upload}}});
    } catch (const std::exception&) {
      // The first error says more. A rule of the bucket removes parts that are left.
    }
    throw;
  }
}

void S3Client::complete_parts(const std::string& key, const std::string& upload,
                              const std::string& list, std::uint64_t bytes) {
  const auto body = [&list](std::uint64_t offset, std::span<char> into) {
    const std::string_view piece = std::string_view(list).substr(offset, into.size());
    std::ranges::copy(piece, into.begin());
    return piece.size();
  };
  const Request request{.method = "POST",
                        .key = key,
                        .query = {{"uploadId", upload}},
                        .body_sha256 = maps::sha256_of(list),
                        .body_bytes = list.size(),
                        .body = body};
  const Answer answer = ask(request);
  // An error may come after the 200; and where the first answer was lost, the upload is gone.
  if (answer.is_well() && answer.code.empty()) return;
  if (answer.code == "NoSuchUpload" && size_of(key) == bytes) return;
  refuse(request, answer);
}

void S3Client::get(const std::string& key, const Sink& sink, const S3Range& range) {
  std::uint64_t received = 0;
  // Of this try: bytes before those that are wanted, where the server ignores the range.
  std::uint64_t skip = 0;
  bool is_first_piece = true;
  std::uint64_t from = range.offset;
  const auto take = [&](int status, std::string_view piece) {
    if (is_first_piece) skip = status == 200 ? from : 0;
    is_first_piece = false;
    const std::uint64_t skipped = std::min<std::uint64_t>(skip, piece.size());
    skip -= skipped;
    piece.remove_prefix(skipped);
    if (range.bytes) piece = piece.substr(0, *range.bytes - received);
    if (piece.empty()) return;
    received += piece.size();
    sink(piece);
  };
  const auto set_range = [&](Request& request) {
    from = range.offset + received;
    is_first_piece = true;
    if (from == 0 && !range.bytes) return;
    request.headers["range"] =
        range.bytes ? fmt::format("bytes={}-{}", from, range.offset + *range.bytes - 1)
                    : fmt::format("bytes={}-", from);
  };
  if (range.bytes == 0) return;
  Request request{.method = "GET", .key = key, .take = take};
  set_range(request);
  const Answer answer = ask(request, set_range);
  // The connection was lost behind the last byte: there is nothing left to ask for.
  if (answer.reply.status == 416 && received > 0) return;
  if (!answer.is_well()) refuse(request, answer);
}

std::string S3Client::get_text(const std::string& key, std::uint64_t most_bytes) {
  std::string text;
  get(key, [&](std::string_view piece) {
    if (text.size() + piece.size() > most_bytes)
      throw S3Error(name_of(key), fmt::format("more than {} bytes", most_bytes), 200);
    text += piece;
  });
  return text;
}

std::optional<std::uint64_t> S3Client::size_of(const std::string& key) {
  const Request request{.method = "HEAD", .key = key};
  const Answer answer = ask(request);
  if (answer.reply.failure.empty() && answer.reply.status == 404) return std::nullopt;
  if (!answer.is_well()) refuse(request, answer);
  const auto length = answer.reply.headers.find("content-length");
  const auto bytes =
      length == answer.reply.headers.end() ? std::nullopt : maps::parse_count(length->second);
  if (!bytes) throw S3Error(name_of(key), "no Content-Length: is this an S3 server?", 200);
  return bytes;
}

void S3Client::list(const std::string& begin, const std::function<void(const Listed&)>& visit) {
  std::string token;
  do {
    Request request{.method = "GET",
                    .key = {},
                    .query = {{"list-type", "2"},
                              {"max-keys", std::to_string(options_.page_objects)},
                              {"prefix", options_.prefix + begin}}};
    if (!token.empty()) request.query["continuation-token"] = token;
    const Answer answer = ask_well(request);
    for (const std::string_view each : xml_elements(answer.body, "Contents")) {
      const std::string key = xml_text(each, "Key").value_or("");
      const auto bytes = maps::parse_count(xml_text(each, "Size").value_or(""));
      if (!key.starts_with(options_.prefix) || !bytes)
        throw S3Error(name_of(begin), "a listing that cannot be read: is this an S3 server?", 200);
      visit({key.substr(options_.prefix.size()), *bytes,
             xml_text(each, "LastModified").value_or("")});
    }
    const bool has_more = xml_text(answer.body, "IsTruncated") == "true";
    token = has_more ? xml_text(answer.body, "NextContinuationToken").value_or("") : "";
    if (has_more && token.empty())
      throw S3Error(name_of(begin), "a listing that does not say how it goes on", 200);
  } while (!token.empty());
}

void S3Client::remove(const std::string& key) {
  const Request request{.method = "DELETE", .key = key};
  const Answer answer = ask(request);
  if (answer.reply.failure.empty() && answer.code == "NoSuchKey") return;
  if (!answer.is_well()) refuse(request, answer);
}

void S3Client::make_bucket() {
  const Request request{.method = "PUT", .key = {}};
  const Answer answer = ask(request);
  if (answer.code == "BucketAlreadyOwnedByYou" || answer.code == "BucketAlreadyExists") return;
  if (!answer.is_well()) refuse(request, answer);
}

}  // namespace stillmap::server
