#include "chaincode/network/files/places.hpp"

#include <fmt/format.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>

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
    if (!places) return Error{file + ": " + places.error().what};
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

}  // namespace ledgerline::fabric_network
