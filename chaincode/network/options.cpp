#include "chaincode/network/options.hpp"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>
#include <algorithm>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "chaincode/identities/identities.hpp"
#include "common/base/file.hpp"
#include "common/fabric/channels.hpp"

namespace ledgerline::network {

namespace {

constexpr const char* loopback = "127.0.0.1";

}  // namespace

bool Options::runs(const std::string& part) const {
  return only.empty() || std::find(only.begin(), only.end(), part) != only.end();
}

Scheduling Options::organisation_scheduling(int number) const {
  const bool waits = std::find(background.begin(), background.end(), fmt::format("org{}", number)) == background.end();
  return waits ? orderer_scheduling() : Scheduling::background;
}

Result<Options> read_options(const std::string& file, Options options) {
  auto config = Config::load(file);
  if (!config) return config.error();
  return read_options(*config, std::move(options));
}

Result<Options> read_options(Config& config, Options options) {
  options.signature_policy =
      config.text({"signature_policy", "of the contract, in Fabric's words", "the channel's, a majority"},
                  options.signature_policy);
  options.ca =
      config.boolean({"ca", "identities from fabric-ca; one host alone, without [[organisation]]"}, options.ca);
  options.history = config.boolean(
      {"history", "the peers' history database; without it `history` fails, and blocks come earlier"}, options.history);
  options.batch_count = static_cast<int>(
      config.integer({"batch_count", "transactions that cut a block: 1 is the fastest, the published flights had 10"},
                     options.batch_count, 1, 10'000));
  options.batch_timeout_ns =
      static_cast<TimeNs>(config.number({"batch_timeout_ms", "or this long after its first transaction"},
                                        to_ms(options.batch_timeout_ns), 1, 60'000) *
                          ns_per_ms);
  options.timeout_ns = from_seconds(
      config.number({"timeout_s", "for the parts on other hosts"}, to_seconds(options.timeout_ns), 1, 3'600));
  const std::size_t channels = config.table_count({"channel", "with the contract on each; none: one, teleop"});
  if (channels > 0) options.channels.clear();
  for (std::size_t i = 0; i < channels; ++i) {
    options.channels.push_back(config.text({fmt::format("channel.{}.name", i), "a-z first, then a-z, 0-9, . and -"}));
  }
  for (auto [table, addresses] :
       {std::pair{Key{"organisation", "of its peer: three, Org1MSP to Org3MSP in this order, or none"},
                  &options.organisation_addresses},
        std::pair{Key{"orderer", "one or three, or none"}, &options.orderer_addresses}}) {
    const std::size_t count = config.table_count(table);
    for (std::size_t i = 0; i < count; ++i) {
      const std::string key = fmt::format("{}.{}.", table.name, i);
      addresses->push_back(
          {config.text({key + "host", "IPv4"}),
           static_cast<std::uint16_t>(config.number({key + "port", "the first of three in a row"}, 1, 65'535))});
    }
  }
  if (!options.orderer_addresses.empty()) options.orderers = static_cast<int>(options.orderer_addresses.size());
  if (Status s = config.finish(); !s) return s.error();
  return options;
}

Status check(const Options& options) {
  if (options.orderers != 1 && options.orderers != 3) {
    return Error{fmt::format("{} orderers: a network has 1 or 3", options.orderers)};
  }
  const std::size_t organisations = options.organisation_addresses.size(), orderers = options.orderer_addresses.size();
  if ((organisations != 0 && organisations != identities::organisations) ||
      (orderers != 0 && orderers != static_cast<std::size_t>(options.orderers)) ||
      (organisations == 0) != (orderers == 0)) {
    return Error{fmt::format("{} addresses of organisations and {} of orderers: give {} and {}, or none", organisations,
                             orderers, identities::organisations, options.orderers)};
  }
  if (options.ca && organisations != 0) {
    return Error{"fabric-ca issues identities of a network on one host: give no addresses with --ca"};
  }
  const ListenAddresses addresses{options.orderer_addresses, options.organisation_addresses, {}};
  std::vector<ListenAddress> all = addresses.orderers;
  all.insert(all.end(), addresses.organisations.begin(), addresses.organisations.end());
  for (std::size_t i = 0; i < all.size(); ++i) {
    in_addr ip{};
    if (::inet_pton(AF_INET, all[i].host.c_str(), &ip) != 1) {
      return Error{fmt::format("\"{}\" is no IPv4 address, such as 10.0.0.1", all[i].host)};
    }
    if (all[i].port > UINT16_MAX - ListenAddresses::ports_each)
      return Error{fmt::format("port {} is too high", all[i].port)};
    for (std::size_t k = 0; k < i; ++k) {
      if (all[k].host == all[i].host && std::abs(all[k].port - all[i].port) < ListenAddresses::ports_each) {
        return Error{fmt::format("{}:{} and {}:{} overlap: each part needs {} ports, from its own on", all[k].host,
                                 all[k].port, all[i].host, all[i].port, ListenAddresses::ports_each)};
      }
    }
  }
  for (const std::string& part : options.only) {
    bool known = false;
    for (int k = 1; k <= identities::organisations; ++k) known = known || part == fmt::format("org{}", k);
    for (int k = 1; k <= options.orderers; ++k) known = known || part == fmt::format("orderer{}", k);
    if (!known) return Error{fmt::format("there is no part \"{}\": org1 to org3, orderer1 ...", part)};
  }
  for (const std::string& part : options.background) {
    bool known = false;
    for (int k = 1; k <= identities::organisations; ++k) known = known || part == fmt::format("org{}", k);
    if (!known) return Error{fmt::format("there is no organisation \"{}\" for the background: org1 to org3", part)};
  }
  if (options.several_hosts() && orderers == 0) {
    return Error{"parts on several hosts need the addresses of all: a file with [[organisation]] and [[orderer]]"};
  }
  if (options.channels.empty()) return Error{"a network needs a channel"};
  for (auto name = options.channels.begin(); name != options.channels.end(); ++name) {
    if (!fabric::is_channel_name(*name)) {
      return Error{fmt::format("\"{}\" is no channel's name: a-z first, then a-z, 0-9, . and -", *name)};
    }
    if (std::find(options.channels.begin(), name, *name) != name) return Error{"channel " + *name + " is named twice"};
  }
  return done;
}

Result<ListenAddress> parse_listen_address(const std::string& text) {
  const auto colon = text.rfind(':');
  ListenAddress address;
  const char* const end = text.data() + text.size();
  if (colon != std::string::npos && colon > 0) {
    address.host = text.substr(0, colon);
    const auto [rest, error] = std::from_chars(text.data() + colon + 1, end, address.port);
    if (error == std::errc() && rest == end && address.port != 0) return address;
  }
  return Error{fmt::format("\"{}\" is no HOST:PORT, such as 10.0.0.1:7051", text)};
}

Status parse_listen_addresses(const std::vector<std::string>& texts, std::vector<ListenAddress>& addresses) {
  addresses.clear();
  for (const std::string& text : texts) {
    auto address = parse_listen_address(text);
    if (!address) return address.error();
    addresses.push_back(std::move(*address));
  }
  return done;
}

std::string ListenAddress::text(int port_offset) const { return fmt::format("{}:{}", host, port + port_offset); }

sockaddr_in ListenAddress::address() const {
  sockaddr_in out{};
  out.sin_family = AF_INET;
  out.sin_port = htons(port);
  ::inet_pton(AF_INET, host.c_str(), &out.sin_addr);
  return out;
}

// For this host alone: every certificate of the orderers' TLS authority is let in, those of the other orderers, too.
std::string ListenAddresses::orderer_admin(int number) const {
  return ListenAddress{loopback, at(orderers, number).port}.text(1);
}
// Without TLS, so for this host alone.
std::string ListenAddresses::orderer_operations(int number) const {
  return ListenAddress{loopback, at(orderers, number).port}.text(2);
}

std::vector<ListenAddress> ListenAddresses::bound(const Options& options) const {
  std::vector<ListenAddress> all;
  const auto at = [](const ListenAddress& address, int offset) {
    return static_cast<std::uint16_t>(address.port + offset);
  };
  for (int k = 1; k <= static_cast<int>(orderers.size()); ++k) {
    const ListenAddress& address = orderers[static_cast<std::size_t>(k - 1)];
    if (!options.runs_orderer(k)) continue;
    for (int i = 0; i < ports_each; ++i) all.push_back({i > 0 ? loopback : address.host, at(address, i)});
  }
  for (int k = 1; k <= static_cast<int>(organisations.size()); ++k) {
    const ListenAddress& address = organisations[static_cast<std::size_t>(k - 1)];
    if (!options.runs_organisation(k)) continue;
    for (int i = 0; i < ports_each; ++i) all.push_back({address.host, at(address, i)});
  }
  return all;
}

ListenAddresses listen_addresses_from(const Options& options, std::uint16_t first_port) {
  ListenAddresses addresses;
  int port = first_port;
  const auto next = [&](int ports = ListenAddresses::ports_each) {
    const ListenAddress address{options.host, static_cast<std::uint16_t>(port)};
    port += ports;
    return address;
  };
  for (int k = 1; k <= options.orderers; ++k) addresses.orderers.push_back(next());
  for (int k = 1; k <= identities::organisations; ++k) addresses.organisations.push_back(next());
  for (int k = 0; options.ca && k <= identities::organisations; ++k) addresses.authorities.push_back(next(1));
  return addresses;
}

namespace {

/// Empty: it is free. Otherwise why it cannot be listened on.
std::string in_the_way_at(const ListenAddress& at) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const int on = 1;
  ::setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
  const sockaddr_in address = at.address();
  const bool free = ::bind(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  const int why = errno;
  ::close(fd);
  if (free) return {};
  return why == EADDRINUSE ? "is taken: does this network run already, or another program?" : std::strerror(why);
}

nlohmann::json to_json(const ListenAddresses& addresses) {
  nlohmann::json document;
  for (const auto& [name, all] : {std::pair{"orderers", &addresses.orderers},
                                  {"organisations", &addresses.organisations},
                                  {"authorities", &addresses.authorities}}) {
    document[name] = nlohmann::json::array();
    for (const ListenAddress& address : *all) document[name].push_back(address.text());
  }
  return document;
}

Result<ListenAddresses> listen_addresses_in(const nlohmann::json& document) {
  ListenAddresses addresses;
  for (const auto& [name, all] : {std::pair{"orderers", &addresses.orderers},
                                  {"organisations", &addresses.organisations},
                                  {"authorities", &addresses.authorities}}) {
    if (!document.is_object() || !document.contains(name) || !document[name].is_array()) return Error{"it is damaged"};
    std::vector<std::string> texts;
    for (const auto& one : document[name]) texts.push_back(one.is_string() ? one.get<std::string>() : "");
    if (Status s = parse_listen_addresses(texts, *all); !s) return s.error();
  }
  if (addresses.organisations.size() != identities::organisations) return Error{"it is damaged"};
  return addresses;
}

/// From the first port on, or where there are enough free ones in a row.
ListenAddresses on_this_host(const Options& options) {
  constexpr int lowest = 20'000, highest = 32'000;  // below the kernel's own choices
  const int parts = ListenAddresses::ports_each * (identities::organisations + options.orderers);
  const auto count = static_cast<std::uint16_t>(parts + (options.ca ? identities::organisations + 1 : 0));
  auto first = options.first_port != 0 ? options.first_port
                                       : static_cast<std::uint16_t>(lowest + (::getpid() * 31) % (highest - lowest));
  ListenAddresses addresses = listen_addresses_from(options, first);
  for (int tried = 0; options.first_port == 0 && tried < 200; ++tried) {
    auto all = addresses.bound({});
    all.insert(all.end(), addresses.authorities.begin(), addresses.authorities.end());
    if (check_free(all)) break;
    first = static_cast<std::uint16_t>(first + count);
    addresses = listen_addresses_from(options, first);
  }
  return addresses;
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

Status check_free(const std::vector<ListenAddress>& addresses) {
  for (const ListenAddress& address : addresses) {
    if (const std::string why = in_the_way_at(address); !why.empty()) {
      return Error{fmt::format("TCP {} {}", address.text(), why)};
    }
  }
  return done;
}

Result<ListenAddresses> choose_listen_addresses(const Options& options) {
  const std::string file = options.dir + "/places.json";
  const bool given = !options.organisation_addresses.empty();
  const ListenAddresses wanted{options.orderer_addresses, options.organisation_addresses, {}};
  if (const auto kept = read_file(file); kept) {
    auto addresses = listen_addresses_in(nlohmann::json::parse(*kept, nullptr, false));
    if (!addresses) return Error{file + ": " + addresses.error().message};
    if (static_cast<int>(addresses->orderers.size()) != options.orderers || (given && *addresses != wanted)) {
      return Error{file + " is of a network with other addresses: begin in an empty directory"};
    }
    if (options.ca == addresses->authorities.empty()) {
      return Error{fmt::format("{} is of a network {} fabric-ca: begin in an empty directory", file,
                               options.ca ? "without" : "with")};
    }
    return addresses;
  }
  ListenAddresses addresses = given ? wanted : on_this_host(options);
  if (Status s = write_file(file, to_json(addresses).dump(1), 0644); !s) return s.error();
  return addresses;
}

std::vector<HostParts> hosts_of(const Options& options) {
  std::vector<HostParts> hosts;
  const auto at = [&](const ListenAddress& address) -> HostParts& {
    const auto known =
        std::find_if(hosts.begin(), hosts.end(), [&](const auto& one) { return one.host == address.host; });
    return known != hosts.end() ? *known : hosts.emplace_back(HostParts{address.host, {}, {}});
  };
  for (std::size_t i = 0; i < options.organisation_addresses.size(); ++i)
    at(options.organisation_addresses[i]).organisations.push_back(static_cast<int>(i) + 1);
  for (std::size_t i = 0; i < options.orderer_addresses.size(); ++i)
    at(options.orderer_addresses[i]).orderers.push_back(static_cast<int>(i) + 1);
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

}  // namespace ledgerline::network
