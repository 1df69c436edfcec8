#!/usr/bin/env python3
"""Measures the shipped scenes and writes docs/reports/ and the numbers of README.md: `make report`.

usage: report.py [--seconds N] [--only STEP,...] [PROGRAM]

Runs `lightpath accuracy`, `bench` and `converge`, the latter for N seconds per scene (default 40). The whole run takes
about five times N and half a minute. All numbers in the tables come from the JSON that the program writes. The copies
that are kept omit the samples of single turns.
"""
import argparse
import datetime
import json
import math
import os
import subprocess
import sys

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
OUT = os.path.join(ROOT, 'docs', 'reports')
MARKS = ['<!-- report: begin -->', '<!-- report: end -->']
BENCHED = ['scenes/still-life.json', 'scenes/spot.json']
# Figure 16 is the soft shadow of the coursework's report. Only the number of light samples varies,
# so that nothing but the light is sampled.
STUDIES = {
    'fig16-area-light-shadow': ['--size', '180x120', '--spp', '1', '--light-samples', '4,16,64,256,1024'],
    'still-life': ['--size', '240x180', '--spp', '1,4,16,64', '--light-samples', '1,4'],
    'thin-lens': ['--size', '480x270', '--spp', '1,4,16,64,256', '--light-samples', '1'],
}


def run(program, *arguments):
    print('+ lightpath', *arguments, flush=True)
    subprocess.run([program, *arguments], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)


def out(name):
    return os.path.join('docs', 'reports', name)


def measure(args):
    os.makedirs(OUT, exist_ok=True)
    steps = args.only.split(',') if args.only else ['accuracy', 'bench', 'converge']
    if 'accuracy' in steps:
        run(args.program, 'accuracy', '--quiet', '--json', out('accuracy.json'), '--html', out('accuracy.html'))
    if 'bench' in steps:
        run(args.program, 'bench', '--quiet', '--backends', 'embree,bvh', '--seconds', f'{args.seconds / 60:.3f}',
            '--rays', '65536', '--json', out('bench.json'), '--html', out('bench.html'), *BENCHED)
    if 'converge' in steps:
        for name, flags in STUDIES.items():
            run(args.program, 'converge', f'scenes/{name}.json', *flags, '--budget', str(args.seconds), '--quiet',
                '--json', out(f'converge-{name}.json'), '--csv', out(f'converge-{name}.csv'),
                '--html', out(f'converge-{name}.html'))
    for name in sorted(os.listdir(OUT)):
        if name.endswith('.json'):
            keep_small(os.path.join(OUT, name))


def keep_small(path):
    """Drops lists of times, and formats tables with one row per line."""
    def without(value):
        if isinstance(value, dict):
            return {k: without(v) for k, v in value.items() if not (k == 'seconds' and isinstance(v, list))}
        return [without(v) for v in value] if isinstance(value, list) else value
    with open(path) as file:
        value = without(json.load(file))
    with open(path, 'w') as file:
        parts = []
        for key, part in value.items():
            if isinstance(part, list) and part:
                part = '[\n  ' + ',\n  '.join(json.dumps(row) for row in part) + ']'
            else:
                part = json.dumps(part)
            parts.append(f'{json.dumps(key)}: {part}')
        file.write('{' + ',\n '.join(parts) + '}\n')


def load(name):
    with open(os.path.join(OUT, name)) as file:
        return json.load(file)


def load_or(name, default):
    return load(name) if os.path.exists(os.path.join(OUT, name)) else default


def wrong_answers():
    """(column, wrong answers, answers) of `accuracy`.

    A tie is wrong only for a backend that promises the lowest index. Older reports count it for all."""
    report = load_or('accuracy.json', {'columns': []})
    for i, column in enumerate(report['columns']):
        entries = [row['entries'][i] for row in report['rows']]
        failed = sum(e['failed'] for e in entries)
        if not column['must_be_right']:
            failed -= sum(e['failures'].get('not the lowest primitive', 0) for e in entries)
        yield column['name'], failed, sum(e['rays'] for e in entries)


def accuracy_lines():
    return [(f'wrong answers to hard rays, `{name}`', f'{failed:,} of {rays:,}')
            for name, failed, rays in wrong_answers()]


def rows_of_most_threads(scene):
    most = max(row['threads'] for row in scene['rows'])
    return [row for row in scene['rows'] if row['threads'] == most]


def rate(rows, what, i):
    """Backend i's rate of the first row of a kind: Mray/s, of builds million triangles a second."""
    return next(row for row in rows if row['what'] == what)['entries'][i]['rate']['value']


def speedup(rows, i):
    """Backend i's speed relative to the first backend: geometric mean over classes and modes of rays."""
    logs = [math.log(row['entries'][i]['ratio']['value']) for row in rows if row['what'] == 'rays']
    return math.exp(sum(logs) / len(logs))


def bench_lines():
    lines = []
    for scene in load_or('bench.json', {'scenes': []})['scenes']:
        first = scene['backends'][0]['name']
        rows = rows_of_most_threads(scene)
        for i, backend in enumerate(scene['backends']):
            text = f"{rate(rows, 'image', i):.1f} Mray/s"
            if i > 0:
                text += f'; rays alone {speedup(rows, i):.2f} times as fast as `{first}`'
            lines.append((f"whole picture of `{scene['name']}`, `{backend['name']}`, {rows[0]['threads']} threads", text))
    return lines


def comparison():
    """README's table: `bvh` and `embree`, which is the first backend of `bench`, in columns for each scene."""
    what = ['whole picture, Mray/s', 'speed of rays alone', 'build, million triangles/s', 'bytes a triangle',
            'bytes a triangle, peak of the build']
    head, rows = [''], [[name] for name in what]
    for scene in load_or('bench.json', {'scenes': []})['scenes']:
        most, backends = rows_of_most_threads(scene), scene['backends']
        name = os.path.basename(scene['name']).removesuffix('.json')
        for i in (1, 0):
            head.append(f"{name}, `{backends[i]['name']}`")
            values = [f"{rate(most, 'image', i):.1f}", f'{speedup(most, i):.2f}' if i else '1', f"{rate(most, 'build', i):.1f}",
                      *(f"{backends[i][key] / scene['triangles']:.0f}" for key in ('bytes', 'peak_bytes'))]
            for row, value in zip(rows, values):
                row.append(value)
    counts = {name: (failed, rays) for name, failed, rays in wrong_answers()}
    # `bvh` has a column for each instruction set: the worst counts.
    ours = max((count for name, count in counts.items() if name.startswith('bvh:')), default=None)
    if ours and 'embree' in counts and len(head) > 2:
        both = [f'{failed:,} of {rays:,}' for failed, rays in (ours, counts['embree'])]
        rows.append(['wrong answers to hard rays', *both, *[''] * (len(head) - 3)])
    lines = [f"| {' | '.join(line)} |\n" for line in [head, *rows]]
    return ''.join([lines[0], '|---' * len(head) + '|\n', *lines[1:]])


def converge_lines(name):
    report, lines = load(f'converge-{name}.json'), []
    scene = f"`{report['scene']}`"
    for ratio in report['ratios']:
        if ratio['samples'] == 64 and ratio['spp'] == 1:
            value, error = ratio['rmse']['value'], ratio['rmse']['standard_error']
            lines.append((f'{scene}: RMSE of independent samples / RMSE of `sobol`, 64 a pixel',
                          f'{value:.2f} ± {error:.2f}'))
    # Slopes of one kind, as in the text of `converge`: the kind with most samplers, then with most
    # points.
    kinds = {}
    for series in report['series']:
        if series['slope']:
            kinds.setdefault(series['fixed'], []).append(series)
    best = max(kinds.values(), key=lambda kind: (len(kind), sum(len(s['points']) for s in kind)), default=[])
    for series in sorted(best, key=lambda series: series['sampler'], reverse=True):
        slope, ends = series['slope'], [report['points'][series['points'][i]]['samples'] for i in (0, -1)]
        lines.append((f"{scene}: RMSE against samples a pixel, {ends[0]} to {ends[1]}, `{series['sampler']}`",
                      f"samples^{slope['slope']:.3f} ± {slope['standard_error']:.3f}"))
    alone = ' (of the light alone: reference and settings have one ray a pixel)' if report['reference']['spp'] == 1 else ''
    for reached in report['reached'][-2:]:
        point = report['points'][reached['point']]
        lights = f" x {n:,} light sample{'s' if n > 1 else ''}" if (n := point['light_samples']) else ''
        text = f"`{point['sampler']}`, {point['spp']} spp{lights}, {point['median_s']:.3g} s"
        for other in (report['points'][i] for i in reached['others']):
            text += f" (`{other['sampler']}`: {other['median_s'] / point['median_s']:.1f} times as long)"
        lines.append((f"{scene}, {report['size'][0]} x {report['size'][1]}: to reach relmse {reached['relmse']:.0e}{alone}", text))
    return lines


def table(lines):
    return '| | |\n|---|---|\n' + ''.join(f'| {a} | {b} |\n' for a, b in lines)


def machine():
    """The one machine and program of all reports."""
    reports = {name: load(name) for name in sorted(os.listdir(OUT)) if name.endswith('.json')}
    if not reports:
        sys.exit('report: found no reports in docs/reports/: run `make report`')
    first, report = next(iter(reports.items()))
    for name, other in reports.items():
        if other['machine'] != report['machine']:
            sys.exit(f"report: {name} is of another machine or program than {first}, and the tables name one:\n"
                     f"{first}: {report['machine']}\n{name}: {other['machine']}\nMeasure all of them: `make report`.")
    m = report['machine']
    versions = ', '.join(f'{name} {version}' for name, version in m['versions'].items())
    threads = [row['threads'] for scene in load_or('bench.json', {'scenes': []})['scenes'] for row in scene['rows']]
    threads += [other['threads'] for other in reports.values() if 'threads' in other]
    return f"{m['cpu']}, {max(threads, default=m['cores'])} threads, {m['isa']} kernels; {versions}; {date()}"


def date():
    """Returns the date of `bench`; without `bench`, today."""
    seconds = load_or('bench.json', {'run': {}})['run'].get('unix_seconds')
    now = datetime.datetime.now(datetime.timezone.utc)
    return (datetime.datetime.fromtimestamp(seconds, now.tzinfo) if seconds else now).date().isoformat()


def write():
    measured_on = machine()
    # Studies that have not been measured are left out.
    there = [name for name in STUDIES if os.path.exists(os.path.join(OUT, f'converge-{name}.json'))]
    studies = {name: converge_lines(name) for name in there}
    pages = [('accuracy', 'the hard cases on every backend'), ('bench', 'backends on the same rays')]
    pages += [(f'converge-{name}', f'error against time of `scenes/{name}.json`') for name in there]
    pages = [page for page in pages if os.path.exists(os.path.join(OUT, f'{page[0]}.json'))]
    index = ['# Reports', '', '`make report` writes this page, the data and the HTML pages into docs/reports/ '
             '(`make report REPORT_SECONDS=300` for longer, calmer numbers). Each HTML page is one file that needs no other. '
             'The repository keeps this page and the JSON data.', '',
             f'Machine: {measured_on}.', '', '| page | what | data |', '|---|---|---|']
    for name, what in pages:
        table_too = ', csv' if name.startswith('converge-') else ''
        index.append(f"| {name}.html | {what} | [json]({name}.json){table_too} |")
    sections = [('Error against time', [line for lines in studies.values() for line in lines]),
                ('Speed', bench_lines()), ('Accuracy', accuracy_lines())]
    sections = [section for section in sections if section[1]]
    for title, lines in sections:
        index += ['', f'## {title}', '', table(lines).rstrip()]
    with open(os.path.join(OUT, 'README.md'), 'w') as file:
        file.write('\n'.join(index) + '\n')
    replace(os.path.join(ROOT, 'README.md'), f'{comparison()}\nMeasured by `make report` on: {measured_on}.\n')


def replace(path, text):
    with open(path) as file:
        page = file.read()
    before, rest = page.split(MARKS[0])
    _, after = rest.split(MARKS[1])
    with open(path, 'w') as file:
        file.write(f'{before}{MARKS[0]}\n{text}{MARKS[1]}{after}')


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('program', nargs='?', default=os.path.join(ROOT, 'target', 'release', 'lightpath'))
    parser.add_argument('--seconds', type=float, default=40)
    parser.add_argument('--only', help='measure only these (accuracy, bench, converge), on the machine and commit of the others; none: only write the '
                        'tables')
    args = parser.parse_args()
    args.program = os.path.abspath(args.program)
    measure(args)
    write()
    return 0


if __name__ == '__main__':
    sys.exit(main())
