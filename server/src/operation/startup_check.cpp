#include "operation/startup_check.hpp"

#include "http/tls.hpp"
#include "signing/ed25519.hpp"

#include <unistd.h>

#include <stillmap/maps/error.hpp>
#include "store/package_store.hpp"

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

namespace stillmap::server {
namespace {

namespace fs = std::filesystem;

struct Trouble {
  std::string found;
  std::string expected;
};

/// @param mode  of access(2). @return why the path cannot be used so.
std::optional<std::string> refused(const fs::path& path, int mode) {
  if (::access(path.c_str(), mode) == 0) return std::nullopt;
  return path.string() + " (" + std::strerror(errno) + ")";
}

/// @param path  empty: the working folder.
std::optional<Trouble> folder_trouble(const fs::path& path, int mode, std::string_view expected) {
  const fs::path folder = path.empty() ? fs::path(".") : path;
  std::error_code error;
  if (fs::exists(folder, error) && !fs::is_directory(folder, error)) {
    return Trouble{folder.string() + " (no folder)", std::string(expected)};
  }
  if (const auto found = refused(folder, mode)) return Trouble{*found, std::string(expected)};
  return std::nullopt;
}

/// A store is served too where it takes no writes; an empty folder must become one, and one that is
/// missing is made in the folder above it.
std::optional<Trouble> store_trouble(const std::string& folder) {
  std::error_code unreadable;
  if (fs::status(folder, unreadable).type() == fs::file_type::not_found) {
    fs::path path = fs::absolute(folder).lexically_normal();
    if (!path.has_filename()) path = path.parent_path();
    return folder_trouble(path.parent_path(), W_OK | X_OK,
                          "a folder to make the store's folder in");
  }
  if (auto found = folder_trouble(folder, R_OK | X_OK, "a folder that can be read")) {
    return found;
  }
  try {
    if (PackageStore::is_store(folder)) return std::nullopt;
  } catch (const maps::StorageError& error) {
    return Trouble{error.what(), "a folder that can be read"};
  }
  return folder_trouble(folder, W_OK, "a folder that can be written to");
}

std::optional<Trouble> log_trouble(const fs::path& file) {
  std::error_code error;
  if (!fs::exists(file, error)) {
    return folder_trouble(file.parent_path(), W_OK | X_OK,
                          "a folder that the log file can be made in");
  }
  const std::string expected = "a file that can be written to";
  if (fs::is_directory(file, error)) return Trouble{file.string() + " (a folder)", expected};
  if (const auto found = refused(file, W_OK)) return Trouble{*found, expected};
  return std::nullopt;
}

std::optional<Trouble> tls_trouble(const TlsOptions& tls) {
  try {
    static_cast<void>(TlsIdentity(tls.certificate_file, tls.key_file));
    return std::nullopt;
  } catch (const maps::InputError& error) {
    return Trouble{error.what(), "a certificate and its key that can be used"};
  }
}

std::optional<Trouble> keys_trouble(const fs::path& file) {
  try {
    static_cast<void>(read_public_keys(file));
    return std::nullopt;
  } catch (const std::exception& error) {
    return Trouble{error.what(), "public keys that can be used"};
  }
}

}  // namespace

std::vector<ConfigProblem> problems_of_files(const ResolvedConfig& config) {
  std::vector<ConfigProblem> problems;
  const auto add = [&](const std::string& key, const std::optional<Trouble>& trouble) {
    if (!trouble) return;
    const auto origin = config.origins.find(key);
    const std::string source = origin == config.origins.end() ? "default" : origin->second;
    problems.push_back({source, key, trouble->found, trouble->expected});
  };
  const ServerOptions& options = config.options;
  if (!options.store.empty()) add("store", store_trouble(options.store));
  if (options.tls.enabled()) add("tls.certificate_file", tls_trouble(options.tls));
  if (!options.trusted_keys_file.empty())
    add("trusted_keys_file", keys_trouble(options.trusted_keys_file));
  if (!options.log.file.empty()) add("log.file", log_trouble(options.log.file));
  return problems;
}

}  // namespace stillmap::server
