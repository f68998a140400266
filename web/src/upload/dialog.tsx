import { useEffect, useState } from 'preact/hooks';
import { ask } from '../api/client.js';
import { Dialog } from '../ui/dialog.js';
import { bytes, plural } from '../ui/format.js';
import { useKept } from '../ui/kept.js';
import { useLoad } from '../ui/load.js';
import { Field, Trouble } from '../ui/parts.js';
import { toApiError, type ApiError } from '../api/errors.js';
import { chosenFile, fromDirectoryInput, fromDrop, type Chosen } from './chosen.js';
import { collectionOf, kKindWords, type Kind } from './kind.js';
import { startUpload } from './manager.js';
import { faultOfName, suggestedMap, suggestedVersion } from './names.js';
import { begunWith } from './remembered.js';
import { choiceOf, undecided, type Selected } from './topics.js';
import { TopicsForm } from './topics_form.js';

/** An upload that was started before: its number, and the name of the drive or version. */
export interface Resumed {
  id: number;
  name: string;
  kind: Kind;
}

export interface UploadDialogProps {
  onClose: () => void;
  /** Already dropped or chosen. */
  chosen?: Chosen | undefined;
  /** The map to upload to; undefined lets the person choose. */
  map?: string | undefined;
  /** The interrupted upload. */
  resume?: Resumed | undefined;
}

/** Asks what to upload and where, and starts the upload. */
export function UploadDialog({ onClose, chosen: first, map, resume }: UploadDialogProps) {
  const [{ chosen, count }, setChosen] = useState({ chosen: first, count: 0 });
  const [error, setError] = useState<ApiError>();
  const choose = (promise: Promise<Chosen | undefined>): void => {
    setError(undefined);
    promise.then((next) => next !== undefined && setChosen((now) => ({ chosen: next, count: now.count + 1 })), (reason: unknown) => setError(toApiError(reason)));
  };
  const title = resume === undefined ? 'Upload' : `Resume “${resume.name}”`;
  const isUsable = chosen !== undefined && 'kind' in chosen.look;
  return (
    <Dialog title={title} onClose={onClose}>
      {resume !== undefined && <p>Choose the same file or folder again. Parts that the server already has are not sent again.</p>}
      <Chooser chosen={chosen} choose={choose} />
      {error !== undefined && <Trouble error={error} />}
      {chosen !== undefined && 'refused' in chosen.look && <p class="trouble" role="alert">{chosen.look.refused}</p>}
      {isUsable && <Where key={count} chosen={chosen} map={map} resume={resume} onClose={onClose} />}
      {!isUsable && (
        <div class="actions"><span class="grow" /><button type="button" onClick={onClose}>Cancel</button></div>
      )}
    </Dialog>
  );
}

function Chooser({ chosen, choose }: { chosen: Chosen | undefined; choose: (promise: Promise<Chosen | undefined>) => void }) {
  const [over, setOver] = useState(false);
  return (
    <div
      class={over ? 'chooser over' : 'chooser'}
      onDragOver={(event) => { event.preventDefault(); setOver(true); }}
      onDragLeave={() => setOver(false)}
      onDrop={(event) => {
        event.preventDefault();
        event.stopPropagation();
        setOver(false);
        if (event.dataTransfer !== null) choose(fromDrop(event.dataTransfer).then((all) => all[0]));
      }}
    >
      {chosen === undefined
        ? <p>Drop a file or a folder here: a map package or a drive as a folder or tar (plain, gzip or zstd), a drive as MCAP, rosbag2 (.db3), ROS 1 bag or rawlog, or a map as LAS, PCD or PLY.</p>
        : <p><strong>{chosen.name}</strong> <span class="quiet">{wordsOf(chosen)}</span></p>}
      <div class="actions">
        <label class="button">
          {chosen === undefined ? 'Choose a file' : 'Another file'}
          <input
            type="file" class="unseen"
            onChange={({ currentTarget: { files } }) => files?.[0] !== undefined && choose(chosenFile(files[0]))}
          />
        </label>
        <label class="button">
          {chosen === undefined ? 'Choose a folder' : 'Another folder'}
          <input
            type="file" class="unseen" {...{ webkitdirectory: true }}
            onChange={({ currentTarget: { files } }) =>
              files !== null && files.length > 0 && choose(fromDirectoryInput([...files]))}
          />
        </label>
      </div>
    </div>
  );
}

function wordsOf({ content, files, look }: Chosen): string {
  if ('refused' in look) return '';
  return `${bytes(content.size)}${files > 1 ? ` · ${plural(files, 'file')}` : ''}${look.sure ? ` · ${kKindWords[look.kind]}` : ''}`;
}

interface WhereProps {
  chosen: Chosen;
  map: string | undefined;
  resume: Resumed | undefined;
  onClose: () => void;
}

/** Map, name and kind of what was chosen. */
function Where({ chosen, map: fixedMap, resume, onClose }: WhereProps) {
  const look = 'kind' in chosen.look ? chosen.look : undefined;
  const [kind, setKind] = useState<Kind>(resume?.kind ?? look?.kind ?? 'package');
  const [typedMap, setMap] = useKept('upload.map', '');
  const [typedName, setName] = useState<string>();
  const [selected, setSelected] = useState<Selected>({});
  const { names: maps, isNew } = useMaps();
  const map = fixedMap ?? (typedMap === '' ? suggestedMap(chosen.name) : typedMap);
  const suggested = useSuggestedName(chosen, kind, map, isNew(map));
  const name = resume?.name ?? typedName ?? suggested ?? '';
  const mapFault = faultOfName(map);
  const nameFault = resume === undefined ? faultOfUploadName(kind, name) : undefined;
  const topics = kind === 'drive' ? (chosen.topics ?? []) : [];
  const isSound = mapFault === undefined && nameFault === undefined && undecided(topics, selected, chosen.ownWords).length === 0;
  const begun = resume === undefined
    ? begunWith({ map, collection: collectionOf(kind), name: chosen.name, bytes: chosen.content.size, changedMs: chosen.changedMs }) : undefined;
  const start = (event: Event, resumedId: number | undefined): void => {
    event.preventDefault();
    if (!isSound) return;
    startUpload({ map, kind, name, chosen, resume: resumedId, choice: choiceOf(selected, topics) });
    onClose();
  };
  return (
    <form onSubmit={(event) => start(event, resume?.id ?? begun?.id)}>
      {look?.sure !== true && resume === undefined && <KindChoice kind={kind} why={look?.why} onKind={setKind} />}
      {fixedMap === undefined && <MapField map={map} maps={maps} isNew={isNew(map)} fault={mapFault} onMap={setMap} />}
      {resume === undefined && (
        <Field
          label={kind === 'drive' ? 'Name of the drive' : 'Name of the version'} fault={typedName === undefined ? undefined : nameFault}
          hint={kind === 'drive' ? 'So that you can tell drives apart.' : 'It cannot be changed later. The version is stored, and not active yet.'}
        >
          {(props) => <input {...props} value={name} onInput={(event) => setName(event.currentTarget.value)} />}
        </Field>
      )}
      {topics.length > 0 && <TopicsForm topics={topics} selected={selected} onSelect={setSelected} ownWords={chosen.ownWords} />}
      {begun !== undefined && <p class="remark" role="status">An upload of this file was interrupted. “Resume” continues it.</p>}
      <div class="actions">
        {begun !== undefined && <button type="button" disabled={!isSound} onClick={(event) => start(event, undefined)}>Start over</button>}
        <span class="grow" />
        <button type="button" onClick={onClose}>Cancel</button>
        <button type="submit" class="primary" disabled={!isSound}>{begun === undefined && resume === undefined ? 'Upload' : 'Resume'}</button>
      </div>
    </form>
  );
}

function MapField({ map, maps, isNew, fault, onMap }: {
  map: string; maps: readonly string[]; isNew: boolean | undefined; fault: string | undefined; onMap: (map: string) => void;
}) {
  const hint = isNew === undefined ? undefined : isNew ? 'A new map.' : 'An existing map.';
  return (
    <Field label="Map" fault={fault} hint={hint}>
      {(props) => (
        <>
          <input {...props} list="upload-maps" value={map} onInput={(event) => onMap(event.currentTarget.value)} />
          <datalist id="upload-maps">{maps.map((one) => <option key={one} value={one} />)}</datalist>
        </>
      )}
    </Field>
  );
}

function KindChoice({ kind, why, onKind }: { kind: Kind; why: string | undefined; onKind: (kind: Kind) => void }) {
  return (
    <fieldset class="field">
      <legend class="field-label">What is it?</legend>
      {why !== undefined && <p class="hint">{why}</p>}
      {(['package', 'drive'] as const).map((one) => (
        <label key={one} class="check">
          <input type="radio" name="upload-kind" checked={kind === one} onChange={() => onKind(one)} /> {kKindWords[one]}
        </label>
      ))}
    </fieldset>
  );
}

/** The server's maps. `isNew` is undefined until they are known. */
function useMaps(): { names: readonly string[]; isNew: (map: string) => boolean | undefined } {
  const { data } = useLoad((signal) => ask('get', '/v1/maps', { signal }), []);
  const names = data?.data.maps.map(({ name }) => name);
  return { names: names ?? [], isNew: (map) => (names === undefined ? undefined : !names.includes(map)) };
}

/** A name for the drive or version; none until it is known which names are taken. */
function useSuggestedName(chosen: Chosen, kind: Kind, map: string, isNewMap: boolean | undefined): string | undefined {
  const taken = useVersionNames(isNewMap === false && kind !== 'drive' ? map : undefined);
  if (kind === 'drive') return driveName(chosen.name);
  return isNewMap === true ? suggestedVersion([]) : taken && suggestedVersion(taken);
}

function faultOfUploadName(kind: Kind, name: string): string | undefined {
  if (kind !== 'drive') return faultOfName(name);
  return name.length > 200 ? 'Use at most 200 characters.' : undefined;
}

function driveName(file: string): string {
  return file.replace(/\.(tar|tgz|tar\.\w+|rawlog|bag|(mcap|db3)(\.zstd)?)$/i, '');
}

/** The names of a map's versions; undefined until they are known. */
function useVersionNames(map: string | undefined): string[] | undefined {
  const [names, setNames] = useState<string[]>();
  useEffect(() => {
    const stop = new AbortController();
    setNames(undefined);
    if (map === undefined) return undefined;
    ask('get', '/v1/maps/{map}/versions', { path: { map }, signal: stop.signal }).then(
      ({ data }) => setNames(data.versions.map(({ version }) => version)), () => undefined);
    return () => stop.abort();
  }, [map]);
  return names;
}
