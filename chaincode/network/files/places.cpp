#include "chaincode/network/files/places.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>

#include "chaincode/identities/identities.hpp"
#include "common/base/file.hpp"

namespace ledgerline::fabric_network {
namespace {

/// Empty: it is free. Otherwise why it cannot be listened on.
std::string in_the_way_at(const ListenAddress& at) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  const sockaddr_in place = at.address();
  const bool free = ::bind(fd, reinterpret_cast<const sockaddr*>(&place), sizeof place) == 0;
  const int why = errno;
  ::close(fd);
  if (free) return {};
  return why == EADDRINUSE ? "is taken: does this network run already, or another program?" : std::strerror(why);
}

nlohmann::json to_json(const ListenAddresses& places) {
  nlohmann::json json;
  for (const auto& [name, all] : {std::pair{"orderers", &places.orderers},
                                  {"organisations", &places.organisations},
                                  {"authorities", &places.authorities}}) {
    json[name] = nlohmann::json::array();
    for (const ListenAddress& place : *all) json[name].push_back(place.text());
  }
  return json;
}

Result<ListenAddresses> places_in(const nlohmann::json& json) {
  ListenAddresses places;
  for (const auto& [name, all] : {std::pair{"orderers", &places.orderers},
                                  {"organisations", &places.organisations},
                                  {"authorities", &places.authorities}}) {
    if (!json.is_object() || !json.contains(name) || !json[name].is_array()) return Error{"it is damaged"};
    for (const auto& one : json[name]) {
      auto place = parse_place(one.is_string() ? one.get<std::string>() : "");
      if (!place) return place.error();
      all->push_back(std::move(*place));
    }
  }
  if (places.organisations.size() != identities::organisations) return Error{"it is damaged"};
  return places;
}

/// From the first port on, or where there are enough free ones in a row.
ListenAddresses on_this_host(const Options& options) {
  constexpr int lowest = 20'000, highest = 32'000;  // below the kernel's own choices
  const int parts = ListenAddresses::ports_each * (identities::organisations + options.orderers);
  const auto count = static_cast<std::uint16_t>(parts + (options.ca ? identities::organisations + 1 : 0));
  auto first = options.first_port != 0 ? options.first_port
                                       : static_cast<std::uint16_t>(lowest + (::getpid() * 31) % (highest - lowest));
  ListenAddresses places = places_from(options, first);
  for (int tried = 0; options.first_port == 0 && tried < 200; ++tried) {
    auto all = places.bound({});
    all.insert(all.end(), places.authorities.begin(), places.authorities.end());
    if (check_free(all)) break;
    first = static_cast<std::uint16_t>(first + count);
    places = places_from(options, first);
  }
  return places;
}

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

Status check_free(const std::vector<ListenAddress>& places) {
  for (const ListenAddress& place : places) {
    if (const std::string why = in_the_way_at(place); !why.empty()) {
      return Error{fmt::format("TCP {} {}", place.text(), why)};
    }
  }
  return done;
}

Result<ListenAddresses> choose_places(const Options& options) {
  const std::string file = options.dir + "/places.json";
  const bool given = !options.organisation_places.empty();
  const ListenAddresses wanted{options.orderer_places, options.organisation_places, {}};
  if (const auto kept = read_file(file); kept) {
    auto places = places_in(nlohmann::json::parse(*kept, nullptr, false));
    if (!places) return Error{file + ": " + places.error().message};
    if (static_cast<int>(places->orderers.size()) != options.orderers || (given && *places != wanted)) {
      return Error{file + " is of a network with other places: begin in an empty directory"};
    }
    if (options.ca == places->authorities.empty()) {
      return Error{fmt::format("{} is of a network {} fabric-ca: begin in an empty directory", file,
                               options.ca ? "without" : "with")};
    }
    return places;
  }
  ListenAddresses places = given ? wanted : on_this_host(options);
  if (Status s = write_file(file, to_json(places).dump(1), 0644); !s) return s.error();
  return places;
}

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
