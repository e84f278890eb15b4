#include <fmt/format.h>
#include <fmt/ranges.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>

#include "chaincode/identities/identities.hpp"
#include "common/base/file.hpp"
#include "common/base/text.hpp"
#include "common/config/config.hpp"
#include "common/crypto/crypto.hpp"
#include "common/rt/clock.hpp"
#include "tools/init/core/host.hpp"

namespace ledgerline::init {
namespace {

namespace fs = std::filesystem;

constexpr const char* key_name = "keystore/priv_sk";

Status make_private_folder(const fs::path& folder) {
  std::error_code error;
  fs::create_directories(folder, error);
  if (!error) fs::permissions(folder, fs::perms::owner_all, error);
  if (error) return Error{fmt::format("making {}: {}", folder.string(), error.message())};
  return done;
}

/// Those whose names end so, in order of their names; none where there is no folder.
std::vector<fs::path> files_in(const fs::path& folder, const std::string& extension) {
  std::vector<fs::path> files;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    if (at->path().extension() == extension) files.push_back(at->path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

/// What a config says of who signs with this folder; empty: no config does.
std::string organisation_of(const std::string& config_dir, const std::string& msp_dir) {
  for (const fs::path& file : files_in(config_dir, ".toml")) {
    auto config = Config::load(file.string());
    std::error_code same, other;
    if (config &&
        fs::weakly_canonical(config->text("ledger.msp_dir", ""), same) == fs::weakly_canonical(msp_dir, other))
      return config->text("ledger.msp_id", "");
  }
  return "";
}

}  // namespace

Status check_authority(const std::string& config_dir, const std::string& msp_dir, const std::string& certificate_pem) {
  const std::string own = organisation_of(config_dir, msp_dir);
  std::string why;
  for (const fs::path& file : files_in(fs::path(config_dir) / "authorities", ".pem")) {
    const std::string id = file.stem().string();
    if (!own.empty() && id != own) continue;
    const auto authority = read_file(file.string());
    if (!authority) return authority.error();
    const Status member = crypto::check_member({id, *authority}, certificate_pem);
    if (member) return done;
    why += fmt::format("; {}: {}", file.string(), member.error().message);
  }
  if (why.empty()) return done;
  const auto certificate = crypto::parse_certificate(certificate_pem);
  if (!certificate) return certificate.error();
  return Error{fmt::format("{} has issued it: it is no member of {}{}", printable(certificate->issuer),
                           own.empty() ? "an organisation here" : own, why)};
}

Status request_identity(const std::string& msp_dir, const std::string& request_file, const crypto::Subject& subject) {
  const fs::path new_key = fs::path(msp_dir) / key_name;
  if (crypto::key_file(msp_dir))
    return Error{fmt::format("{}/keystore has a key already; move it away for a new one", msp_dir)};
  // Not found is not enough: a folder that cannot be read may have one.
  if (auto status = check_new({new_key.string(), request_file}); !status) return status;
  auto made = crypto::make_request(subject);
  if (!made) return made.error();
  if (auto status = make_private_folder(new_key.parent_path()); !status) return status;
  // On the disk before anybody has the request: a certificate of a lost key is of no use.
  if (auto status = replace_file(new_key.string(), made->key_pem, 0600); !status) return status;
  return write_file(request_file, made->request_pem);
}

Result<std::string> install_certificate(const Directories& folders, const std::string& certificate_file) {
  const std::string msp_dir = folders.msp();
  const auto delivered = read_file(certificate_file);
  if (!delivered) return delivered.error();
  if (const auto any = crypto::parse_certificate(*delivered); !any)
    return Error{certificate_file + ": " + any.error().message};
  const auto key_file = crypto::key_file(msp_dir);
  if (!key_file) return Error{key_file.error().message + ": make one with `ledgerline init --request NAME`"};
  auto key = read_file(*key_file);
  if (!key) return key.error();
  const auto pem = crypto::own_first(*key, *delivered);
  if (!pem) return Error{fmt::format("{} and {}: {}", certificate_file, *key_file, pem.error().message)};
  const auto certificate = crypto::parse_certificate(*pem);
  if (!certificate) return Error{certificate_file + ": " + certificate.error().message};
  if (certificate->not_after_s < realtime_ns() / ns_per_s) return Error{certificate_file + " has expired"};
  if (const Status issued = check_authority(folders.config, msp_dir, *pem); !issued)
    return Error{fmt::format("{}: {}. What is in {} stays", certificate_file, issued.error().message, msp_dir)};
  const fs::path folder = fs::path(msp_dir) / "signcerts";
  if (auto status = replace_file((folder / "cert.pem").string(), *pem); !status) return status.error();
  // Programs take the first one by name.
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    if (at->path().extension() == ".pem" && at->path().filename() != "cert.pem") fs::remove(at->path(), error);
  }
  if (error) return Error{fmt::format("{}: {}", folder.string(), error.message())};
  return certificate->subject;
}

Status collect_public(const std::string& ledger_dir, const std::string& out) {
  std::vector<NewFile> files;
  const auto add = [&](const fs::path& from, const std::string& to) -> Status {
    auto content = read_file(from);
    if (!content) return content.error();
    files.push_back({out + "/" + to, std::move(*content)});
    return done;
  };
  for (int k = 1; k <= identities::organisations; ++k) {
    const std::string domain = identities::domain_of(k), id = identities::msp_id_of(k);
    const fs::path folder = identities::organisation_dir(ledger_dir, k);
    if (auto status = add(folder / "ca" / ("ca." + domain + "-cert.pem"), "authorities/" + id + ".pem"); !status)
      return status;
    if (auto status = add(folder / "tlsca" / ("tlsca." + domain + "-cert.pem"), "tls/" + id + ".pem"); !status)
      return status;
  }
  const std::string orderers = identities::domain_of(0);
  const fs::path ordering = identities::ordering_dir(ledger_dir) / "tlsca" / ("tlsca." + orderers + "-cert.pem");
  if (fs::exists(ordering)) {
    if (auto status = add(ordering, "tls/orderers.pem"); !status) return status;
    const fs::path authority = identities::ordering_dir(ledger_dir) / "ca" / ("ca." + orderers + "-cert.pem");
    if (auto status = add(authority, "orderers-ca.pem"); !status) return status;
  }
  std::size_t blocks = 0;
  std::error_code error;
  for (fs::directory_iterator at(ledger_dir, error), end; !error && at != end; at.increment(error)) {
    if (at->path().extension() != ".block") continue;
    ++blocks;
    if (auto status = add(at->path(), at->path().filename().string()); !status) return status;
  }
  if (error) return Error{fmt::format("reading {}: {}", ledger_dir, error.message())};
  if (blocks == 0) return Error{ledger_dir + " has no CHANNEL.block: start the ledger once"};
  return write_new(files);
}

Status check_new(const std::vector<std::string>& paths) {
  std::vector<std::string> there;
  for (const std::string& path : paths) {
    std::error_code error;
    // A link that leads nowhere is there, too.
    if (std::filesystem::symlink_status(path, error).type() != std::filesystem::file_type::not_found)
      there.push_back(path);
  }
  if (there.empty()) return done;
  return Error{fmt::format("{} {} there already; nothing was written. Move what is no longer wanted away",
                           fmt::join(there, ", "), there.size() == 1 ? "is" : "are")};
}

Status write_new(const std::vector<NewFile>& files) {
  std::vector<std::string> others;
  std::vector<const NewFile*> missing;
  for (const NewFile& file : files) {
    const auto known = read_file(file.path);
    if (known && *known == file.content) continue;
    others.push_back(file.path);
    missing.push_back(&file);
  }
  if (auto status = check_new(others); !status) return status;
  for (const NewFile* file : missing)
    if (auto status = write_file(file->path, file->content, file->mode); !status) return status;
  return done;
}

}  // namespace ledgerline::init
