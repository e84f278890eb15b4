#include "tools/station/shell/options.hpp"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <thread>

#include "common/base/log.hpp"
#include "common/base/text.hpp"
#include "common/config/config.hpp"
#include "common/program/program.hpp"
#include "ground/shell/settings.hpp"
#include "tools/command/runtime_folder.hpp"

namespace ledgerline::station {
namespace {

constexpr const char* station_variable = "LEDGERLINE_STATION";
constexpr const char* token_variable = "LEDGERLINE_TOKEN_FILE";
constexpr const char* ca_variable = "LEDGERLINE_CA";

/// [service] of ground's own file. The rest of it is ground's to check.
Result<ground::service::ServiceSettings> service_of(const std::string& file) {
  const auto whole = Config::load(file);
  if (!whole) return whole.error();
  auto config = Config::parse(whole->table_text("service"), file);
  if (!config) return config.error();
  auto settings = ground::service_settings(*config);
  if (auto status = config->finish(); !status) return status.error();
  if (settings.listen.empty())
    return Error{file + ": [service] listen is not set: this ground serves no page and no API"};
  return settings;
}

/// Per station, since a token is known to one alone; where a log-out or a restart removes it, if there is such a place.
std::string usual_session_file(const StationAddress& address, const Environment& environment) {
  const std::string folder = runtime_folder(environment("XDG_RUNTIME_DIR"), environment("HOME"));
  return folder.empty() ? "" : fmt::format("{}/session-{}-{}", folder, address.at.host, address.at.port);
}

/// The config of the ground of this user's flight; empty: no flight has left one.
std::string flight_config(const Environment& environment) {
  const std::string folder = runtime_folder(environment("XDG_RUNTIME_DIR"), environment("HOME"));
  const std::string link = folder + "/" + flight_link;
  struct stat info {};
  return !folder.empty() && ::lstat(link.c_str(), &info) == 0 ? link : "";
}

std::string session_in(const Target& target) {
  if (target.session_file.empty()) return "";
  const bool there = ::access(target.session_file.c_str(), F_OK) == 0;
  if (!there && !target.session_expected) return "";
  const auto session = read_secret(target.session_file);
  if (session && is_token(*session)) return *session;
  spdlog::warn("without a session: {}", session ? target.session_file + " holds none" : session.error().message);
  return "";
}

}  // namespace

const char* const shared_notes =
    "The station: --url and --token-file, else [service] of --config, else LEDGERLINE_STATION and\n"
    "LEDGERLINE_TOKEN_FILE, else your own flight's. With https:// its certificate must be of --ca, else of\n"
    "LEDGERLINE_CA, else of an authority that this computer trusts; with --config alone it is the one that the\n"
    "config names.\n"
    "Exit codes: 0 done; 1 the station refused, or is not reached; 2 bad usage.";

void add_options(CommandLine& line, Options& options) {
  line.option("--url", options.url, "the station's address, as http://127.0.0.1:8800, https://ground.example.org:8800");
  line.option("--token-file", options.token_file, "file of the page's token, which nobody else may read");
  line.option("--config", options.config, "ground.toml, whose [service] says both").existing_file();
  line.option("--session-file", options.session_file, "file of an operator's session; else one for each station");
  line.option("--ca", options.tls.authority, "PEM file of the authority of the station's certificate").existing_file();
  line.option("--certificate", options.tls.certificate, "PEM file of our own, where the station asks for one")
      .existing_file();
  line.option("--key", options.tls.key, "PEM file of its key, which nobody else may read").existing_file();
  line.flag("--json", options.json, "JSON in a table's place");
}

Result<Target> target_of(const Options& options, const Environment& environment) {
  ground::service::ServiceSettings service;
  Target target;
  const bool is_named = !options.config.empty() || !options.url.empty() || !environment(station_variable).empty();
  const std::string config = is_named ? options.config : flight_config(environment);
  if (!config.empty()) {
    if (!is_named)
      target.hint =
          "; " + config + " names it: of a flight that has ended ground.log and report.html tell, and this file may go";
    auto read = service_of(config);
    if (!read) return Error{read.error().message + target.hint};
    service = std::move(*read);
  }
  const std::string url = !options.url.empty()     ? options.url
                          : service.listen.empty() ? environment(station_variable)
                                                   : "";
  if (url.empty() && service.listen.empty())
    return Error{
        fmt::format("which station? --url http://127.0.0.1:8800, --config ground.toml, or {}; no flight of yours is "
                    "watched (`ledgerline fly --watch`)",
                    station_variable)};
  auto address = url.empty() ? address_from_service(service) : address_from_url(url);
  if (!address && url.empty()) return Error{fmt::format("{}: service.listen {}", config, address.error().message)};
  if (!address) return address.error();
  target.address = std::move(*address);
  target.token_file = !options.token_file.empty()   ? options.token_file
                      : !service.token_file.empty() ? service.token_file
                                                    : environment(token_variable);
  if (target.token_file.empty())
    return Error{fmt::format("which token? --token-file FILE, --config ground.toml, or {}", token_variable)};
  target.tls = options.tls;
  if (target.tls.certificate.empty() != target.tls.key.empty()) return Error{"--certificate and --key go together"};
  // Who reads the config is on the station's computer, and its file is as good as an authority.
  if (target.tls.authority.empty() && url.empty()) target.tls.authority = service.tls.certificate;
  if (target.tls.authority.empty()) target.tls.authority = environment(ca_variable);
  target.token_named = !options.token_file.empty();
  const bool is_session_named = !options.session_file.empty();
  target.session_expected = is_session_named && !options.signs_in;
  target.session_file = is_session_named ? options.session_file : usual_session_file(target.address, environment);
  return target;
}

Result<Target> target_of(const Options& options) { return target_of(options, environment_variable); }

Result<std::unique_ptr<Station>> open(const Target& target) {
  auto token = read_secret(target.token_file);
  if (!token) return Error{token.error().message + (target.token_named ? "" : target.hint)};
  if (token->empty()) return Error{target.token_file + " is empty: remove it, and ground makes a new one"};
  if (!is_token(*token)) return Error{target.token_file + " must hold 64 hex digits, as ground made it"};
  return Station::open(target.address, {.token = std::move(*token),
                                        .session = session_in(target),
                                        .session_file = target.session_file,
                                        .tls = target.tls,
                                        .token_file = target.token_file,
                                        .hint = target.hint});
}

int run(const Options& options, const std::function<Status(Station& station, const Target& target)>& act) {
  const auto target = target_of(options);
  if (!target) return fail(target.error(), exit_usage);
  const auto station = open(*target);
  if (!station) return fail(station.error());
  return exit_code(act(**station, *target));
}

void print_refreshed(const std::string& text) {
  fmt::print("{}{}", ::isatty(STDOUT_FILENO) == 1 ? "\x1b[H\x1b[J" : "", text);
  std::fflush(stdout);
}

void rest(TimeNs duration_ns) {
  for (const TimeNs until_ns = monotonic_ns() + duration_ns; !stop_requested && monotonic_ns() < until_ns;)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
}

std::string time_of_day(double t_ms, double now_ms) {
  const auto at = static_cast<std::time_t>((static_cast<double>(realtime_ns()) / 1e6 - (now_ms - t_ms)) / 1e3);
  std::tm local{};
  localtime_r(&at, &local);
  char text[16];
  std::strftime(text, sizeof text, "%H:%M:%S", &local);
  return text;
}

}  // namespace ledgerline::station
