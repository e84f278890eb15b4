#include "tools/identity/shell/identity_source.hpp"

#include <fmt/format.h>
#include <stdlib.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <system_error>

#include "common/base/file.hpp"
#include "common/base/log.hpp"

namespace ledgerline::identity {
namespace {

namespace fs = std::filesystem;

Status make_folder(const fs::path& folder, fs::perms permissions) {
  std::error_code error;
  if (fs::exists(folder, error)) return done;
  fs::create_directories(folder, error);
  if (!error) fs::permissions(folder, permissions, error);
  if (error) return Error{fmt::format("making {}: {}", folder.string(), error.message())};
  return done;
}

/// A new key for the user that read the old one: the renewing user may be root, and the service a user of its own.
Status set_owner_like(const std::string& before, const std::string& key) {
  struct stat info {};
  if (::stat(before.c_str(), &info) != 0) return done;  // there was none
  if (::chown(key.c_str(), info.st_uid, info.st_gid) == 0) return done;
  const int why = errno;
  ::unlink(key.c_str());
  return Error{fmt::format("{}: giving it to the owner of {}: {}", key, before, std::strerror(why))};
}

}  // namespace

bool is_free(const crypto::IdentitySource& source) {
  if (source.msp_dir.empty()) return !fs::exists(source.files.certificate) && !fs::exists(source.files.private_key);
  return !crypto::certificate_file(source.msp_dir) && !crypto::key_file(source.msp_dir);
}

Status put(const crypto::IdentitySource& source, const crypto::Renewal::Pair& pair) {
  if (source.msp_dir.empty()) {
    // Both beside their places first: what cannot be written takes no key away.
    const auto& [certificate, key] = source.files;
    const std::string fresh = key + ".renewed";
    if (Status s = replace_file(fresh, pair.key_pem, 0600); !s) return s;
    if (Status s = set_owner_like(key, fresh); !s) return s;
    if (Status s = write_file(certificate + ".new", pair.certificate_pem); !s) return s;
    if (std::rename(fresh.c_str(), key.c_str()) != 0)
      return Error{fmt::format("cannot write {}: {}", key, std::strerror(errno))};
    return replace_file(certificate, pair.certificate_pem);
  }
  const fs::path folder = source.msp_dir;
  const auto before = source.files_now();
  if (Status s = make_folder(folder / "keystore", fs::perms::owner_all); !s) return s;
  if (Status s = make_folder(folder / "signcerts", fs::perms(0755)); !s) return s;
  const auto hash = crypto::certificate_hash(pair.certificate_pem);
  if (!hash) return hash.error();
  // A new name, so that the old pair is whole until the certificate is in its place.
  const fs::path key = folder / "keystore" / (crypto::hex(*hash).substr(0, 16) + "_sk");
  if (Status s = replace_file(key.string(), pair.key_pem, 0600); !s) return s;
  if (before) {
    if (Status s = set_owner_like(before->private_key, key.string()); !s) return s;
  }
  const auto old = crypto::certificate_file(source.msp_dir);
  if (Status s = replace_file(old ? *old : (folder / "signcerts" / "cert.pem").string(), pair.certificate_pem); !s)
    return s;
  if (!before || before->private_key == key) return done;
  std::error_code error;
  fs::remove(before->private_key, error);
  if (error) return Error{fmt::format("the old key stays, {}: {}", before->private_key, error.message())};
  return done;
}

Result<Home> Home::make(const std::string& beside) {
  const fs::path parent = fs::absolute(beside).lexically_normal().parent_path();
  if (Status s = make_folder(parent, fs::perms(0755)); !s) return s.error();
  std::string name = (parent / ".identity-XXXXXX").string();
  if (::mkdtemp(name.data()) == nullptr)
    return Error{fmt::format("making a folder in {}: {}", parent.string(), std::strerror(errno))};
  return Home(name);
}

Status Home::put_pair(const crypto::Renewal::Pair& pair) const {
  for (const char* folder : {"keystore", "signcerts"}) {
    if (Status s = make_folder(folder_ / "msp" / folder, fs::perms::owner_all); !s) return s;
  }
  if (Status s = write_file((folder_ / "msp/keystore/lent_sk").string(), pair.key_pem, 0600); !s) return s;
  return write_file((folder_ / "msp/signcerts/cert.pem").string(), pair.certificate_pem);
}

Home::~Home() {
  if (folder_.empty()) return;
  std::error_code error;
  fs::remove_all(folder_, error);
  if (error) spdlog::warn("{} stays, with a key in it: {}", folder_.string(), error.message());
}

}  // namespace ledgerline::identity
