#include "chaincode/network/files/hosts.hpp"

#include <algorithm>
#include <filesystem>

#include "chaincode/identities/identities.hpp"

namespace ledgerline::fabric_network {
namespace {

namespace fs = std::filesystem;

bool is_key(const fs::path& file) { return file.filename() == "priv_sk" || file.extension() == ".key"; }

/// Copies below `to` what lies at the same place below `from`; the first failure stops it. A copy has the rights of
/// what it is a copy of, and has them before there is anything in it.
class Copy {
 public:
  Copy(fs::path from, fs::path to) : from_(std::move(from)), to_(std::move(to)) {}

  void file(const fs::path& name) {
    if (!status_) return;
    std::error_code error;
    fs::create_directories((to_ / name).parent_path(), error);
    if (!error) fs::copy_file(from_ / name, to_ / name, error);
    if (error) status_ = Error{"copying " + (from_ / name).string() + " to " + to_.string() + ": " + error.message()};
  }
  void folder(const fs::path& name, bool keys) {
    std::error_code error;
    for (const auto& entry : fs::recursive_directory_iterator(from_ / name, error)) {
      if (entry.is_regular_file() && (keys || !is_key(entry.path()))) file(fs::relative(entry.path(), from_));
    }
    if (error && status_) status_ = Error{"reading " + (from_ / name).string() + ": " + error.message()};
  }
  const Status& status() const { return status_; }

 private:
  const fs::path from_, to_;
  Status status_ = done;
};

bool has(const std::vector<int>& numbers, int number) {
  return std::find(numbers.begin(), numbers.end(), number) != numbers.end();
}

void copy_organisation(Copy& copy, int number, bool own) {
  const fs::path folder = identities::organisation_dir("", number);
  for (const char* common : {"msp", "ca", "tlsca"}) copy.folder(folder / common, false);
  if (own) {
    for (const char* members : {"peers", "chaincode", "users"}) copy.folder(folder / members, true);
  } else {
    copy.file(identities::peer_dir("", number) / "tls" / "ca.crt");  // who commits asks the peers of all
  }
}

void copy_orderers(Copy& copy, const std::vector<int>& own, int all) {
  for (const char* common : {"msp", "ca", "tlsca"}) copy.folder(identities::ordering_dir("") / common, false);
  for (int number = 1; number <= all; ++number) {
    if (has(own, number)) {
      copy.folder(identities::orderer_dir("", number), true);
    } else {
      copy.folder(identities::orderer_dir("", number) / "tls", false);  // a channel's configuration names them
    }
  }
}

}  // namespace

std::vector<HostParts> hosts_of(const Options& options) {
  std::vector<HostParts> hosts;
  const auto at = [&](const ListenAddress& place) -> HostParts& {
    const auto known =
        std::find_if(hosts.begin(), hosts.end(), [&](const auto& one) { return one.host == place.host; });
    return known != hosts.end() ? *known : hosts.emplace_back(HostParts{place.host, {}, {}});
  };
  for (std::size_t i = 0; i < options.organisation_places.size(); ++i)
    at(options.organisation_places[i]).organisations.push_back(static_cast<int>(i) + 1);
  for (std::size_t i = 0; i < options.orderer_places.size(); ++i)
    at(options.orderer_places[i]).orderers.push_back(static_cast<int>(i) + 1);
  return hosts;
}

Status write_host(const std::string& from, const HostParts& parts, const Options& options, const std::string& to) {
  std::error_code error;
  if (fs::exists(to, error)) return done;
  const std::string unfinished = to + ".unfinished";
  fs::remove_all(unfinished, error);
  if (error) return Error{"removing " + unfinished + ": " + error.message()};
  Copy copy(from, unfinished);
  for (int k = 1; k <= identities::organisations; ++k) copy_organisation(copy, k, has(parts.organisations, k));
  copy_orderers(copy, parts.orderers, options.orderers);
  copy.file("places.json");
  for (const std::string& channel : options.channels) {
    copy.file(channel + ".block");
    copy.file(fs::path("done") / ("block-" + channel));
  }
  if (!copy.status()) return copy.status();
  fs::rename(unfinished, to, error);
  if (error) return Error{"renaming " + unfinished + ": " + error.message()};
  return done;
}

}  // namespace ledgerline::fabric_network
