#include <fcntl.h>
#include <fmt/format.h>
#include <openssl/crypto.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

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
  } else if (secret && (info.st_mode & 077) != 0) {
    status =
        Error{fmt::format("{} may be read by others than its owner; run: chmod 600 {}", path.string(), path.string())};
  } else {
    out.resize(static_cast<std::size_t>(info.st_size));
    if (::read(fd, out.data(), out.size()) != static_cast<ssize_t>(out.size())) {
      status = Error{fmt::format("cannot read {}", path.string())};
    }
  }
  ::close(fd);
  return status;
}

/// The first file by name, of those with the ending that there is (cryptogen and fabric-ca make exactly one).
Result<fs::path> only_file(const fs::path& folder, const std::string& ending) {
  std::error_code error;
  std::vector<fs::path> found;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    if (at->path().filename().string().ends_with(ending)) found.push_back(at->path());
  }
  if (error) return Error{fmt::format("cannot read folder {}: {}", folder.string(), error.message())};
  if (found.empty()) return Error{fmt::format("{} has no file *{}", folder.string(), ending)};
  return *std::min_element(found.begin(), found.end());
}

struct Named {
  fs::path file;
  std::string pem;
  X509Ptr certificate;
  std::string subject;
};

Result<Named> read_named(const std::string& msp_dir) {
  auto file = only_file(fs::path(msp_dir) / "signcerts", ".pem");
  if (!file) return file.error();
  Named named{.file = *file, .pem = {}, .certificate = {}, .subject = {}};
  if (auto s = read_file(*file, false, named.pem); !s) return s.error();
  auto parsed = read_certificate(named.pem);
  if (!parsed) return Error{file->string() + ": " + parsed.error().what};
  auto description = describe(parsed->get());
  if (!description) return Error{file->string() + ": " + description.error().what};
  named.certificate = std::move(*parsed);
  named.subject = description->subject;
  return named;
}

/// `pass_phrase`: null where none locks the key.
Result<SigningIdentity> load(Library library, const std::string& msp_id, const std::string& msp_dir,
                             const std::string* pass_phrase) {
  const auto named = read_named(msp_dir);
  if (!named) return named.error();
  auto key_file = only_file(fs::path(msp_dir) / "keystore", "_sk");
  if (!key_file) return key_file.error();
  Secret key;
  if (auto s = read_file(*key_file, true, key.text); !s) return s.error();
  if (pass_phrase != nullptr) {
    auto unlocked = unlock_key(key.text, *pass_phrase);
    if (!unlocked) return Error{key_file->string() + ": " + unlocked.error().what};
    key.text.swap(*unlocked);
  }
  auto signer = make_signer(library, key.text);
  if (!signer) return Error{key_file->string() + ": " + signer.error().what};
  auto verifier = make_verifier(library, named->certificate.get());
  if (!verifier) return Error{named->file.string() + ": " + verifier.error().what};
  auto probe = (*signer)->sign("");
  if (!probe) return probe.error();
  if (!(*verifier)->verify("", *probe)) {
    return Error{
        fmt::format("the key {} does not belong to the certificate {}", key_file->string(), named->file.string())};
  }

  SigningIdentity identity;
  identity.name = {msp_id, named->subject};
  msp::SerializedIdentity serialized;
  serialized.set_mspid(msp_id);
  serialized.set_id_bytes(named->pem);
  identity.serialized = serialized.SerializeAsString();
  identity.signer = std::move(*signer);
  return identity;
}

}  // namespace

Result<SigningIdentity> load_identity(Library library, const std::string& msp_id, const std::string& msp_dir) {
  return load(library, msp_id, msp_dir, nullptr);
}

Result<SigningIdentity> load_locked_identity(Library library, const std::string& msp_id, const std::string& msp_dir,
                                             const std::string& pass_phrase) {
  return load(library, msp_id, msp_dir, &pass_phrase);
}

Result<IdentityName> read_identity_name(const std::string& msp_id, const std::string& msp_dir) {
  const auto named = read_named(msp_dir);
  if (!named) return named.error();
  return IdentityName{msp_id, named->subject};
}

}  // namespace ledgerline::crypto
