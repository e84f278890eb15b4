#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/crypto.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "common/base/file.hpp"
#include "common/crypto/crypto.hpp"
#include "common/crypto/openssl.hpp"
#include "msp/identities.pb.h"

namespace ledgerline::crypto {
namespace {

namespace fs = std::filesystem;

/// Text that is wiped when it is no longer needed.
struct Secret {
  Secret() = default;
  Secret(const Secret&) = delete;
  Secret& operator=(const Secret&) = delete;
  ~Secret() { OPENSSL_cleanse(text.data(), text.size()); }
  std::string text;
};

constexpr off_t max_file_bytes = 1 << 20;

Status read_file(const fs::path& path, bool secret, std::string& out) {
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (fd < 0) return Error{fmt::format("cannot open {}: {}", path.string(), std::strerror(errno))};
  struct stat info {};
  Status status = done;
  if (::fstat(fd, &info) != 0 || !S_ISREG(info.st_mode) || info.st_size > max_file_bytes) {
    status = Error{fmt::format("{} is not a file of keys or certificates", path.string())};
  } else if (secret && !is_private(info)) {
    status =
        Error{fmt::format("{} may be read by others than its owner; run: chmod 600 {}", path.string(), path.string())};
  } else {
    if (secret) keep_memory_private();
    out.resize(static_cast<std::size_t>(info.st_size));
    if (::read(fd, out.data(), out.size()) != static_cast<ssize_t>(out.size())) {
      status = Error{fmt::format("cannot read {}", path.string())};
    }
  }
  ::close(fd);
  return status;
}

/// In order of their names. Kubernetes' own folders and links (..data) are none.
std::vector<fs::path> files_in(const fs::path& folder, std::error_code& error) {
  std::vector<fs::path> files;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    if (!at->path().filename().string().starts_with('.')) files.push_back(at->path());
  }
  std::ranges::sort(files);
  return files;
}

/// The first file by name with the ending (cryptogen and fabric-ca make exactly one), or the one of that name, or the
/// only one that there is.
Result<std::string> file_in(const fs::path& folder, const std::string& ending, const std::string& name) {
  std::error_code error;
  const std::vector<fs::path> all = files_in(folder, error);
  if (error) return Error{fmt::format("cannot read folder {}: {}", folder.string(), error.message())};
  const auto found = std::ranges::find_if(all, [&](const fs::path& path) {
    const std::string file = path.filename().string();
    return file.ends_with(ending) || file == name;
  });
  if (found != all.end()) return found->string();
  if (all.size() == 1) return all.front().string();
  if (all.empty()) return Error{fmt::format("{} has no file *{}", folder.string(), ending)};
  return Error{
      fmt::format("{} has {} files, none of them *{}: which one counts?", folder.string(), all.size(), ending)};
}

struct Named {
  fs::path file;
  std::string pem;
  X509Ptr certificate;
  std::string subject;
};

Result<Named> read_named(const fs::path& file) {
  Named named{.file = file, .pem = {}, .certificate = {}, .subject = {}};
  if (auto s = read_file(file, false, named.pem); !s) return s.error();
  auto parsed = read_certificate(named.pem);
  if (!parsed) return Error{file.string() + ": " + parsed.error().message};
  auto description = describe(parsed->get());
  if (!description) return Error{file.string() + ": " + description.error().message};
  named.certificate = std::move(*parsed);
  named.subject = description->subject;
  return named;
}

/// Of the files beside `first` the one that fits; `first` where that is the only one, or none fits: to load it then
/// says what is wrong. A locked key fits nobody here, and one who has such has one alone.
std::string key_of(const std::string& certificate_file, std::string first) {
  std::string certificate;
  if (!read_file(certificate_file, false, certificate)) return first;
  std::error_code error;
  const std::vector<fs::path> keys = files_in(fs::path(first).parent_path(), error);
  if (keys.size() < 2) return first;
  for (const fs::path& file : keys) {
    Secret key;
    if (read_file(file, true, key.text) && check_fits(key.text, certificate)) return file.string();
  }
  return first;
}

/// `pass_phrase`: null where none locks the key.
Result<SigningIdentity> load(Library library, const std::string& msp_id, const IdentityFiles& files,
                             const std::string* pass_phrase) {
  const auto named = read_named(files.certificate);
  if (!named) return named.error();
  Secret key;
  if (auto s = read_file(files.private_key, true, key.text); !s) return s.error();
  if (pass_phrase != nullptr) {
    auto unlocked = unlock_key(key.text, *pass_phrase);
    if (!unlocked) return Error{files.private_key + ": " + unlocked.error().message};
    key.text.swap(*unlocked);
  }
  auto signer = make_signer(library, key.text);
  if (!signer) return Error{files.private_key + ": " + signer.error().message};
  auto verifier = make_verifier(library, named->certificate.get());
  if (!verifier) return Error{named->file.string() + ": " + verifier.error().message};
  auto probe = (*signer)->sign("");
  if (!probe) return probe.error();
  if (!(*verifier)->verify("", *probe)) {
    return Error{
        fmt::format("the key {} does not belong to the certificate {}", files.private_key, named->file.string())};
  }

  SigningIdentity identity;
  identity.name = {msp_id, named->subject};
  identity.serialized = serialized_identity(msp_id, named->pem);
  identity.signer = std::move(*signer);
  return identity;
}

}  // namespace

Result<std::string> authorities_in(const std::string& msp_dir) {
  std::string all;
  for (const char* folder : {"cacerts", "intermediatecerts"}) {
    std::error_code error;
    const fs::path place = fs::path(msp_dir) / folder;
    for (const fs::path& file : files_in(place, error)) {
      std::string pem;
      if (auto s = read_file(file, false, pem); !s) return s.error();
      all += pem + "\n";
    }
    if (error && error != std::errc::no_such_file_or_directory)
      return Error{fmt::format("cannot read folder {}: {}", place.string(), error.message())};
  }
  return all;
}

Result<std::string> certificate_file(const std::string& msp_dir) {
  return file_in(fs::path(msp_dir) / "signcerts", ".pem", "tls.crt");
}

Result<std::string> key_file(const std::string& msp_dir) {
  return file_in(fs::path(msp_dir) / "keystore", "_sk", "priv-key.pem");
}

Result<IdentityFiles> identity_files(const std::string& msp_dir) {
  auto certificate = certificate_file(msp_dir);
  if (!certificate) return certificate.error();
  auto key = key_file(msp_dir);
  if (!key) return key.error();
  return IdentityFiles{*certificate, key_of(*certificate, std::move(*key))};
}

std::string serialized_identity(const std::string& msp_id, const std::string& certificate_pem) {
  msp::SerializedIdentity identity;
  identity.set_mspid(msp_id);
  identity.set_id_bytes(certificate_pem);
  return identity.SerializeAsString();
}

Result<NamedCertificate> read_serialized(std::string_view serialized) {
  msp::SerializedIdentity identity;
  if (!identity.ParseFromArray(serialized.data(), static_cast<int>(serialized.size())))
    return Error{"it is no identity"};
  auto certificate = parse_certificate(identity.id_bytes());
  if (!certificate) return certificate.error();
  IdentityName name{identity.mspid(), certificate->subject};
  return NamedCertificate{std::move(name), std::move(*certificate)};
}

Result<SigningIdentity> load_identity(Library library, const std::string& msp_id, const std::string& msp_dir) {
  const auto files = identity_files(msp_dir);
  return files ? load(library, msp_id, *files, nullptr) : files.error();
}

Result<SigningIdentity> load_identity(Library library, const std::string& msp_id, const IdentityFiles& files) {
  return load(library, msp_id, files, nullptr);
}

Result<SigningIdentity> load_locked_identity(Library library, const std::string& msp_id, const std::string& msp_dir,
                                             const std::string& pass_phrase) {
  const auto files = identity_files(msp_dir);
  return files ? load(library, msp_id, *files, &pass_phrase) : files.error();
}

Result<IdentityName> read_identity_name(const std::string& msp_id, const std::string& msp_dir) {
  const auto file = certificate_file(msp_dir);
  if (!file) return file.error();
  const auto named = read_named(*file);
  if (!named) return named.error();
  return IdentityName{msp_id, named->subject};
}

Result<std::string> read_key_file(const std::string& path) {
  std::string text;
  if (auto s = read_file(path, true, text); !s) return s.error();
  return text;
}

}  // namespace ledgerline::crypto
